"""``stridelab demo``: the main job on the bundled recording, whose truth is known because it was simulated."""

import shutil
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from stridelab.cli_console import out
from stridelab.cli_estimate import EstimateRequest, estimate_here, show_estimate
from stridelab.cli_output import refuse_to_overwrite, result_folder
from stridelab.errors import Unavailable
from stridelab.resources import models_dir


def sample_folder() -> Path:
    """Where the bundled recording lies. Raises ``Unavailable`` where the installation lacks it."""
    folder = models_dir() / "recordings" / "sample-walk"
    if not (folder / "recording.c3d").is_file():
        raise Unavailable("sample-missing", f"The bundled recording is not in {folder}; install stridelab again.")
    return folder


def demo(*, out_dir: Path | None, force: bool) -> None:
    """Estimate the bundled recording with its latency corrected, and show the error against the truth."""
    target = out_dir or Path("stridelab-demo")
    refuse_to_overwrite(target, force=force)
    source = sample_folder()
    out.print(f"A simulated person walks over two force plates: {escape(str(source / 'recording.c3d'))}")
    with result_folder(target, force=force) as folder:
        result = estimate_here(EstimateRequest(file=source / "recording.c3d", latency="apply"), folder)
        for name in ("truth.parquet", "truth.csv"):
            shutil.copyfile(source / name, folder / name)
        from stridelab.service.jobs.kinds.truth import com_errors_mm

        errors = com_errors_mm(folder / "com.parquet", folder / "truth.parquet")
    show_estimate(result, target, as_json=False)
    table = Table("RMS error, mm", "x", "y", "z", box=None, pad_edge=False)
    for name, values in errors.items():
        table.add_row(name, *(f"{value:.1f}" for value in values))
    out.print(table)
    out.print("Next: stridelab serve, then open the address it prints; or stridelab estimate your-trial.c3d")
