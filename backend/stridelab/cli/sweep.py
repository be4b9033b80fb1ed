"""``stridelab sweep``: plans a scenario over ranges of up to three parameters, here or on a service."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.markup import escape

from stridelab.cli.options import ControlOption, Delivery, Densities, NodeRate, SolverOption
from stridelab.cli.results import deliver_result, out, run_here, show_files, show_remarks
from stridelab.errors import Fault, InvalidInput
from stridelab.pipelines.scenarios.scenario_files import known_scenario
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.sweeps import SweepInput, SweepSummary, SweepTask
from stridelab.service.local_runs import validate_options

SCOPES: Final = {
    "centre of mass": "centre of mass only: whether the body can follow was not computed",
    "whole body": "whole body: it follows the plan, and its certificate passes",
}
"""Description of each scope of the counts."""


@dataclass(frozen=True)
class SweepRequest:
    """Options of ``stridelab sweep``; ``vary`` holds ``FIELD=FROM:TO:NUMBER``."""

    scenario: Annotated[str, typer.Argument(help="A scenario's JSON file, or the name of a bundled one: long-stride.")]
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary", help="FIELD=FROM:TO:NUMBER, up to three times; stride, height (metres), timing, friction."
        ),
    ]
    formulation: ControlOption = "forces"
    solver: SolverOption = "auto"
    node_rate_hz: NodeRate = 10.0
    measure: Densities = None
    processes: Annotated[
        int | None, typer.Option("--processes", min=1, help="Parallel processes; all cores by default.")
    ] = None
    whole_body: Annotated[
        bool,
        typer.Option(
            "--whole-body", help="Compute and certify the whole-body motion of each plan; takes seconds each."
        ),
    ] = False

    def to_input(self, scenario: Scenario | None) -> SweepInput:
        """Input of the job; without a scenario, the name is taken as a scenario id.

        Raises ``InvalidInput`` (``option-invalid``) naming the invalid option.
        """
        fields: dict[str, Any] = {"scenario_id": self.scenario} if scenario is None else {"scenario": scenario}
        fields |= {"formulation": self.formulation, "solver": self.solver, "node_rate_hz": self.node_rate_hz}
        fields |= {"whole_body": self.whole_body}
        return validate_options(SweepInput, {**fields, "measure": self.measure, "vary": parse_ranges(self.vary)})


def parse_ranges(typed: Sequence[str]) -> dict[str, tuple[float, float, int]]:
    """Parse ``FIELD=FROM:TO:NUMBER`` options; returns (from, to, number) by field."""
    by_field: dict[str, tuple[float, float, int]] = {}
    for text in typed:
        field, _, values = text.partition("=")
        parts = values.split(":")
        try:
            low, high, number = parts
            by_field[field] = (float(low), float(high), int(number))
        except ValueError as error:
            fault = Fault("--vary", f"{text} is not FIELD=FROM:TO:NUMBER")
            raise InvalidInput("option-invalid", "A field is varied as in stride=0.6:1.05:50.", [fault]) from error
    return by_field


def run_sweep(request: SweepRequest, delivery: Delivery) -> None:
    """Test for which strides, heights, timings and frictions a scenario has a motion; needs no server."""
    title = Path(request.scenario).stem

    def compute_result(folder: Path) -> JobResult:
        scenario = known_scenario(request.scenario, on_service=delivery.server is not None)
        input_ = request.to_input(scenario)
        if scenario is not None and delivery.server is None:
            task = SweepTask(scenario=scenario, input=input_)
            return run_here("sweep", title, task, folder, processes=request.processes)
        from stridelab.cli.remote import run_remotely_as_is

        return run_remotely_as_is("sweep", title, input_, folder, delivery)

    deliver_result(f"{title}-sweep", delivery, compute_result, show_swept)


def show_swept(result: JobResult, target: Path) -> None:
    """Print how many scenarios have a motion, and the ranges."""
    summary = SweepSummary.model_validate(result.summary)
    out.print(
        f"[bold]{escape(summary.scenario_name)}[/] {summary.feasible} of {summary.points} scenarios have a motion "
        f"({SCOPES[summary.scope]}); rejected before solving: {summary.refused}, "
        f"without a solution: {summary.infeasible}"
    )
    for axis in summary.axes:
        unit = f" {axis.unit}" if axis.unit else ""
        out.print(
            f"{axis.field:<9} {axis.values[0]:g} to {axis.values[-1]:g}{unit}, {len(axis.values)} values; "
            f"the scenario itself has {axis.present:g}{unit}"
        )
    served = ", ".join(f"{name} {number}" for name, number in summary.solvers.items()) or "none"
    out.print(
        f"solvers: {served}; {summary.solve_time_s:.2f} s of processor time in them, {summary.wall_time_s:.1f} s "
        f"in all on {summary.processes} processes"
    )
    if summary.solver_because:
        out.print(escape(summary.solver_because))
    show_remarks(summary.warnings)
    show_files(result, target)
