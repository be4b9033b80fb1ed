"""``stridelab demo``: runs both main jobs on bundled data.

The recording is simulated, so its true centre of mass is known; the motion is planned for a bundled scenario.
"""

import shutil
from pathlib import Path
from typing import Final

from rich.markup import escape
from rich.table import Table

from stridelab.cli.estimate import estimate_here, show_estimate
from stridelab.cli.options import EstimateRequest, Walk
from stridelab.cli.plan_motion import PlanRequest, plan_here, show_plan
from stridelab.cli.results import out
from stridelab.errors import Unavailable
from stridelab.machine.models_folder import models_dir
from stridelab.service.local_runs import refuse_to_overwrite, result_folder

WALK, CLIMB = "walk", "climb"
"""Folders of the two results."""
STAIRS: Final = "six-stairs"


def sample_folder() -> Path:
    """Folder of the bundled recording. Raises ``Unavailable`` if the installation lacks it."""
    folder = models_dir() / "recordings" / "sample-walk"
    if not (folder / "recording.c3d").is_file():
        raise Unavailable("sample-missing", f"The bundled recording is not in {folder}; install stridelab again.")
    return folder


def run_demo(*, out_dir: Path | None, force: bool, stairs: str = STAIRS) -> None:
    """Estimate a walk into ``<out_dir>/walk`` and plan the scenario ``stairs`` into ``<out_dir>/climb``."""
    target = out_dir or Path("stridelab-demo")
    for name in (WALK, CLIMB):
        refuse_to_overwrite(target / name, force=force)
    _estimate_walk(target / WALK, force=force)
    out.print()
    _plan_climb(target / CLIMB, stairs, force=force)
    out.print()
    out.print("Next: stridelab serve, then open the address it prints; or stridelab estimate your-trial.c3d")


def _estimate_walk(target: Path, *, force: bool) -> None:
    """Estimate the bundled recording with its latency corrected, and show the error against the truth."""
    source = sample_folder()
    out.print(f"A simulated person walks over two force plates: {escape(str(source / 'recording.c3d'))}")
    with result_folder(target, force=force) as folder:
        result = estimate_here(EstimateRequest(Walk(source / "recording.c3d")), folder)
        for name in ("truth.parquet", "truth.csv"):
            shutil.copyfile(source / name, folder / name)
        from stridelab.simulation.truth_table import com_errors_mm

        errors = com_errors_mm(folder / "com.parquet", folder / "truth.parquet")
    show_estimate(result, target)
    table = Table("RMS error, mm", "x", "y", "z", box=None, pad_edge=False)
    for name, values in errors.items():
        table.add_row(name, *(f"{value:.1f}" for value in values))
    out.print(table)


def _plan_climb(target: Path, stairs: str, *, force: bool) -> None:
    """Plan the bundled stairs with the whole body, and replay the motion."""
    out.print(f"Planning the whole-body motion of the scenario {escape(stairs)}, then replaying it in physics")
    with result_folder(target, force=force) as folder:
        result, failure = plan_here(PlanRequest(stairs), folder)
    show_plan(result, target)
    if failure is not None:
        raise failure
