"""The ``stridelab`` command line: starts the service, and runs its main jobs without one.

Numeric packages are imported inside the commands, so that ``stridelab --help`` answers at once; the modules of the
commands themselves, with the contracts they need, where a command is looked up.
"""

import gc
import importlib
import os
import signal
from collections.abc import Iterator, Mapping, MutableMapping
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import typer
from typer.core import TyperGroup

from stridelab import __version__
from stridelab.cli.options import (
    AsJson,
    BestMethod,
    Delivery,
    Estimation,
    Force,
    Gait,
    Lab,
    OutFolder,
    Preparation,
    Walk,
    Walks,
    with_groups,
)
from stridelab.cli.results import FAILURE, INTERRUPTED, exit_code, out, show_error
from stridelab.errors import StridelabError
from stridelab.schemas.methods import Method
from stridelab.schemas.recordings import Sex


class Elsewhere(NamedTuple):
    """A command, or a group of commands, in a module of its own: ``function`` there, with ``groups`` of options."""

    module: str
    function: str
    groups: bool = False
    help: str | None = None


ELSEWHERE: Final[Mapping[str, Elsewhere]] = {
    "serve": Elsewhere("serve", "serve"),
    "worker": Elsewhere("serve", "worker"),
    "migrate": Elsewhere("serve", "migrate"),
    "backup": Elsewhere("backup", "backup"),
    "restore": Elsewhere("backup", "restore"),
    "adopt": Elsewhere("backup", "adopt"),
    "token": Elsewhere("tokens", "tokens"),
    "stream": Elsewhere("stream", "stream"),
    "bridge": Elsewhere("bridges.command", "bridge"),
    "live": Elsewhere("live", "live"),
    "fit-cycloid": Elsewhere("fit_cycloid", "fit_cycloid"),
    "imitate": Elsewhere("imitate", "imitate"),
    "study-population": Elsewhere("study_population", "study_population"),
    "measures": Elsewhere("measures", "measure_gait"),
    "com-bench": Elsewhere("compare", "bench_methods"),
    "report": Elsewhere("measures", "report_gait"),
    "plan": Elsewhere(
        "plan_motion",
        "plan_scenario",
        groups=True,
        help="Plan how a robot carries out a contact scenario, check the motion and replay it; needs no server.",
    ),
    "sweep": Elsewhere("sweep", "run_sweep", groups=True),
    "plan-contacts": Elsewhere("contacts", "plan_contacts"),
    "export-contacts": Elsewhere(
        "contacts", "export_contacts", help="Write a scenario's contacts as JSON with multicontact-api's field names."
    ),
    "import-contacts": Elsewhere(
        "contacts", "import_contacts", help="Convert such JSON to a scenario, if the robot can carry it out."
    ),
    "read-terrain": Elsewhere("contacts", "read_terrain"),
    "learn-reachability": Elsewhere("learn_reachability", "learn_reachability"),
    "add-robot": Elsewhere("learn_reachability", "add_robot"),
}
"""Commands that are imported when they are looked up."""
HERE_AFTER: Final[Mapping[str, tuple[str, ...]]] = {
    "token": ("estimate", "compare"),
    "report": ("simulate",),
    "add-robot": ("reproduce", "demo", "doctor", "version"),
}
"""Commands of this module that follow one of ``ELSEWHERE`` in the help."""


class CommandsOnDemand(MutableMapping[str, Any]):
    """Commands by name; those of ``ELSEWHERE`` are imported at their first use."""

    def __init__(self, here: Mapping[str, Any]) -> None:
        self.loaded = dict(here)
        ordered = (name for other in ELSEWHERE for name in (other, *HERE_AFTER.get(other, ())))
        self.names = list(dict.fromkeys([*ordered, *here]))

    def __getitem__(self, name: str) -> Any:
        """The command, imported if it was not; raises ``KeyError`` if there is none."""
        if name not in self.loaded:
            self.loaded[name] = load_command(name, ELSEWHERE[name])
        return self.loaded[name]

    def __setitem__(self, name: str, command: Any) -> None:
        """Add a command at the end of the help."""
        self.loaded[name] = command
        self.names = list(dict.fromkeys([*self.names, name]))

    def __delitem__(self, name: str) -> None:
        """Remove a command."""
        self.names.remove(name)
        self.loaded.pop(name, None)

    def __contains__(self, name: object) -> bool:
        """Whether there is such a command, without importing it."""
        return name in self.names

    def __iter__(self) -> Iterator[str]:
        """Names in the order of the help."""
        return iter(self.names)

    def __len__(self) -> int:
        """Number of commands."""
        return len(self.names)


def load_command(name: str, where: Elsewhere) -> Any:
    """Import a command, or a group of commands, and build it as typer does."""
    function = getattr(importlib.import_module(f"stridelab.cli.{where.module}"), where.function)
    if isinstance(function, typer.Typer):
        return typer.main.get_group(function)
    single = typer.Typer(add_completion=False)
    single.command(name=name, help=where.help)(with_groups(function) if where.groups else function)
    return typer.main.get_command(single)


class Commands(TyperGroup):
    """Command group that turns a ``StridelabError`` into one line and an exit code, and Ctrl-C into an exit code."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands = CommandsOnDemand(self.commands)

    def invoke(self, ctx: Any) -> Any:
        """Run the command and translate its errors."""
        try:
            return super().invoke(ctx)
        except StridelabError as error:
            show_error(error)
            raise typer.Exit(exit_code(error)) from error
        except KeyboardInterrupt as interrupt:
            raise typer.Exit(INTERRUPTED) from interrupt


app = typer.Typer(
    name="stridelab",
    cls=Commands,
    help="Centre of mass of human gait and motions of climbing humanoid robots, as a service and on the command line.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
@with_groups
def estimate(
    *,
    walks: Walks,
    method: BestMethod = None,
    estimation: Estimation,
    preparation: Preparation,
    delivery: Delivery,
) -> None:
    """Estimate the centre of mass of one recording, or of each of a session; needs no server."""
    from stridelab.cli.estimate import estimate_recording as run
    from stridelab.cli.options import EstimateRequest

    if len(walks.files) == 1 and not walks.files[0].is_dir():
        run(EstimateRequest(walks.to_walks(walks.files)[0], method, estimation, preparation), delivery)
        return
    from stridelab.cli.session import estimate_session, recordings_below  # with the tasks of all jobs on recordings

    each = walks.to_walks(recordings_below(walks.files))
    estimate_session([EstimateRequest(walk, method, estimation, preparation) for walk in each], delivery)


@app.command()
@with_groups
def compare(
    *,
    walk: Walk,
    method: Annotated[
        Method | None, typer.Option("--method", help="Compare only this method with the segment geometry.")
    ] = None,
    estimation: Estimation,
    preparation: Preparation,
    truth: Annotated[Path | None, typer.Option("--truth", help="truth.parquet of a simulated recording.")] = None,
    delivery: Delivery,
) -> None:
    """Compare all estimators on one recording; needs no server."""
    from stridelab.cli.compare import compare_methods as run
    from stridelab.cli.options import EstimateRequest

    request = EstimateRequest(walk, method, estimation, preparation)
    run(request, truth=truth, delivery=delivery)


@app.command()
def simulate(
    out_dir: OutFolder = None,
    seed: Annotated[int, typer.Option("--seed", help="Varies the walk and its noise.")] = 0,
    duration_s: Annotated[float, typer.Option("--duration", help="Seconds, 2 to 60.")] = 6.0,
    robot: Annotated[str, typer.Option("--robot", help="human, or the name of a robot on two legs.")] = "human",
    gait: Annotated[Gait, typer.Option("--gait", help="Only TALOS runs, with flight phases.")] = "walking",
    speed_m_s: Annotated[
        float | None, typer.Option("--speed", help="Speed in m/s, 0 to 2; by default that of the walker.")
    ] = None,
    height_m: Annotated[
        float | None, typer.Option("--height", help="Stature of the person in metres; default 1.71.")
    ] = None,
    mass_kg: Annotated[
        float | None, typer.Option("--mass", help="Mass of the person in kilograms; default 60.")
    ] = None,
    sex: Annotated[Sex | None, typer.Option("--sex", help="Proportions of the person; default female.")] = None,
    lab: Annotated[Lab, typer.Option("--lab", help="Plates under every footprint, or two in a row.")] = "walkway",
    noise: Annotated[
        list[str] | None, typer.Option("--noise", help="FIELD=VALUE, e.g. force_n=2; may be repeated.")
    ] = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Simulate a walk of a person or of a robot: writes recording.c3d and the true centre of mass."""
    from stridelab.cli.estimate import simulate_walk as run

    stated = {"speed_m_s": speed_m_s, "height_m": height_m, "mass_kg": mass_kg, "sex": sex}
    fields: dict[str, object] = {"seed": seed, "duration_s": duration_s, "robot": robot, "gait": gait, "lab": lab}
    fields |= {name: value for name, value in stated.items() if value is not None}
    run(fields, noise=tuple(noise or ()), out_dir=out_dir, force=force, as_json=as_json)


@app.command()
@with_groups
def reproduce(
    *,
    item: Annotated[
        str | None,
        typer.Argument(
            help="fig-2.2, fig-2.5 to fig-2.9, fig-3.3 to fig-3.10, fig-4.2 to fig-4.9, table-4.1, numbers-2 to -4; "
            "with --recordings also fig-2.8-people, fig-2.9-people, fig-3.3-people to fig-3.10-people, "
            "numbers-3-people, height-people, weights-people, real-walks."
        ),
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="All items, as one HTML report.")] = False,
    seeds: Annotated[int | None, typer.Option("--seeds", help="Number of random draws, 1 to 200.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="First seed of the draws; 0 by default.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="With --all: only three draws, for a quick look.")] = False,
    recordings: Annotated[
        Path | None,
        typer.Option("--recordings", help="With --all or an item on people: folder whose gait/ holds walks."),
    ] = None,
    delivery: Delivery,
) -> None:
    """Recompute a figure of the thesis and compare its numbers with ours; needs no server."""
    from stridelab.cli.reproduce import reproduce_item as run
    from stridelab.cli.reproduce import require_one

    name = require_one(
        item,
        everything=everything,
        quick=quick,
        recordings=recordings,
        server=delivery.server,
        drawn=seeds is not None,
        seeded=seed is not None,
    )
    if name is not None and recordings is None:
        run(name, seeds, seed, delivery)
        return
    from stridelab.cli.reproduce import reproduce_all

    if not reproduce_all(
        None if name is None else (name,),
        seeds=seeds,
        seed=seed,
        quick=quick,
        recordings=recordings,
        out_dir=delivery.out_dir,
        recompute=delivery.force,
        as_json=delivery.as_json,
    ):
        raise typer.Exit(FAILURE)


@app.command()
def demo(out_dir: OutFolder = None, force: Force = False) -> None:
    """Run both main jobs: estimate a walk with known truth, and plan a robot that climbs stairs."""
    from stridelab.cli.demo import run_demo as run

    run(out_dir=out_dir, force=force)


@app.command()
def doctor(
    service: Annotated[
        str | None, typer.Option("--service", help="Only check whether this service is healthy.")
    ] = None,
    worker: Annotated[
        bool, typer.Option("--worker", help="Only check whether the worker of the data folder is alive.")
    ] = False,
    files: Annotated[
        bool, typer.Option("--files", help="Only read all stored files and compare them with their hashes.")
    ] = False,
) -> None:
    """Check this machine for what the service needs; prints a fix for each failed check."""
    from stridelab.cli.doctor.machine import check_machine, report_service, report_worker

    if files:
        from stridelab.cli.backup import verify_files

        if not verify_files():
            raise typer.Exit(FAILURE)
    if files and not service and not worker:
        return
    passed = [report_service(service)] if service else []
    if worker:
        passed.append(report_worker())
    if not (all(passed) if passed else check_machine()):
        raise typer.Exit(FAILURE)


@app.command()
def version() -> None:
    """Print the version."""
    out.print(__version__)


def main() -> None:
    """Run the command line; exit codes are those of ``cli.results.EXIT_CODES``."""
    # Small matrices: threads of the linear algebra only wait for each other. The service's computations have one, too.
    for library in ("OMP", "OPENBLAS"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # A supervisor ends its children with SIGTERM: the same quiet way out as Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        app()
    finally:
        gc.freeze()  # at its end, Python would search all that was imported for garbage: a tenth of an estimate


if __name__ == "__main__":
    main()
