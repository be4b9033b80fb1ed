"""The commands of the robots as they are typed.

What they do is in ``cli_plan``, ``cli_sweep``, ``cli_contacts``, ``cli_interchange`` and ``cli_learn``.
"""

from pathlib import Path
from typing import Annotated

import typer

from stridelab.cli_groups import Delivery, with_groups
from stridelab.cli_options import Control, Densities, NodeRate, PostureMeasure, Solver
from stridelab.schemas.plans import DURATION_RANGE, Film, Shape

ScenarioName = Annotated[str, typer.Argument(help="A scenario's JSON file, or the name of a bundled one: six-stairs.")]
OutFile = Annotated[Path | None, typer.Option("--out-file", help="The file to write; must not exist yet.")]
ForceFile = Annotated[bool, typer.Option("--force", help="Replace that file.")]


@with_groups
def plan(
    *,
    scenario: ScenarioName,
    no_whole_body: Annotated[
        bool, typer.Option("--no-whole-body", help="Only the plan of the centre of mass and the contact forces.")
    ] = False,
    replay: Annotated[
        bool | None,
        typer.Option("--replay/--no-replay", help="Replay the motion in physics; done unless --no-whole-body."),
    ] = None,
    measure: Densities = None,
    formulation: Control = "forces",
    solver: Solver = "auto",
    node_rate: NodeRate = 10.0,
    shape: Annotated[
        Shape | None,
        typer.Option("--shape", help="Forces between nodes: cubic splines, or constant; splines where a body follows."),
    ] = None,
    time_limit: Annotated[
        float | None, typer.Option("--time-limit", help="Seconds of processor time for the solver, at most 300.")
    ] = None,
    free_durations: Annotated[
        bool, typer.Option("--free-durations", help="Let the solver choose how long each phase lasts.")
    ] = False,
    duration_range: Annotated[
        tuple[float, float], typer.Option("--duration-range", help="Between how many times what the scenario says.")
    ] = DURATION_RANGE,
    film: Annotated[
        Film | None, typer.Option("--film", help="A film of the motion as well: gif or mp4; needs ffmpeg.")
    ] = None,
    delivery: Delivery,
) -> None:
    """Plan how a robot carries out a contact scenario, check the motion and replay it; needs no server."""
    from stridelab.cli_plan import PlanRequest
    from stridelab.cli_plan import plan as run

    request = PlanRequest(
        scenario,
        whole_body=not no_whole_body,
        replay=replay,
        measure=measure,
        formulation=formulation,
        solver=solver,
        node_rate_hz=node_rate,
        shape=shape,
        time_limit_s=time_limit,
        free_durations=free_durations,
        duration_range=duration_range,
        film=film,
    )
    run(request, delivery)


@with_groups
def sweep(
    *,
    scenario: Annotated[str, typer.Argument(help="A scenario's JSON file, or the name of a bundled one: long-stride.")],
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary", help="FIELD=FROM:TO:NUMBER, up to three times; stride, height (metres), timing, friction."
        ),
    ],
    formulation: Control = "forces",
    solver: Solver = "auto",
    node_rate: NodeRate = 10.0,
    measure: Densities = None,
    processes: Annotated[
        int | None, typer.Option("--processes", min=1, help="Scenarios at a time; all cores by default.")
    ] = None,
    whole_body: Annotated[
        bool,
        typer.Option(
            "--whole-body", help="Let the body follow each plan: its certificate decides. Takes seconds each."
        ),
    ] = False,
    delivery: Delivery,
) -> None:
    """Find out at which strides, heights, paces and frictions a scenario has a motion; needs no server."""
    from stridelab.cli_sweep import SweepRequest
    from stridelab.cli_sweep import sweep as run

    request = SweepRequest(scenario, tuple(vary), formulation, solver, node_rate, measure, processes, whole_body)
    run(request, delivery)


@with_groups
def plan_contacts(
    *,
    task: Annotated[
        str, typer.Argument(help="A JSON file with terrain, start and goal, or a scenario: its ends are taken.")
    ],
    delivery: Delivery,
) -> None:
    """Find a sequence of contacts over a terrain, from a stance to a goal stance; needs no server."""
    from stridelab.cli_contacts import plan_contacts as run

    run(task, delivery)


def export_contacts(
    scenario: ScenarioName,
    out_file: OutFile = None,
    force: ForceFile = False,
) -> None:
    """Write a scenario's contacts as JSON with multicontact-api's field names."""
    from stridelab.cli_interchange import export_contacts as run

    run(scenario, out_file=out_file, force=force)


def import_contacts(
    file: Annotated[Path, typer.Argument(help="JSON with multicontact-api's field names.")],
    beside: Annotated[
        str | None,
        typer.Option("--beside", help="A scenario, or its name: robot, terrain and friction where FILE has none."),
    ] = None,
    out_file: OutFile = None,
    force: ForceFile = False,
) -> None:
    """Write the scenario of such JSON, if the robot can do it."""
    from stridelab.cli_interchange import import_contacts as run

    run(file, beside=beside, out_file=out_file, force=force)


@with_groups
def learn_reachability(
    *,
    robot: Annotated[str, typer.Argument(help="A robot by name: talos, hrp2, g1.")],
    measure: Annotated[
        PostureMeasure, typer.Option("--measure", help="How postures are drawn: in all, or of a robot that stands.")
    ] = "uniform",
    samples: Annotated[int | None, typer.Option("--samples", help="Postures to keep, 500 to 200000.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of the postures and of the fits.")] = None,
    effector: Annotated[
        list[str] | None, typer.Option("--effector", help="Learn this effector only; may be repeated.")
    ] = None,
    delivery: Delivery,
) -> None:
    """Learn where a robot's centre of mass can be, seen from its effectors; needs no server."""
    from stridelab.cli_learn import learn_reachability as run

    asked = {"robot": robot, "measure": measure, "samples": samples, "seed": seed, "effectors": effector or None}
    run(asked, delivery)
