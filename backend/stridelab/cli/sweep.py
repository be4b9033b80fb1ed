"""``stridelab sweep``: plans a scenario over ranges of up to three parameters, here or on a service."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rich.markup import escape

from stridelab.cli.options import Delivery, PlanSolver, PostureMeasure
from stridelab.cli.results import (
    out,
    progress_bar,
    refuse_to_overwrite,
    result_folder,
    show_files,
    show_json,
    show_remarks,
    validate_options,
    write_result,
)
from stridelab.cli.scenario_files import read_scenario
from stridelab.errors import Fault, InvalidInput, NotFound
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import Formulation
from stridelab.schemas.scenarios import Scenario
from stridelab.schemas.sweeps import SweepInput, SweepSummary
from stridelab.schemas.tasks import SweepTask

SCOPES: Final = {
    "centre of mass": "centre of mass only: whether the body can follow was not computed",
    "whole body": "whole body: it follows the plan, and its certificate passes",
}
"""Description of each scope of the counts."""


@dataclass(frozen=True)
class SweepRequest:
    """Options of ``stridelab sweep``; ``vary`` holds ``FIELD=FROM:TO:NUMBER``."""

    scenario: str
    vary: Sequence[str]
    formulation: Formulation = "forces"
    solver: PlanSolver = "auto"
    node_rate_hz: float = 10.0
    measure: PostureMeasure | None = None
    processes: int | None = None
    whole_body: bool = False

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
    """Plan all scenarios here or on a server, write the result folder and show the summary."""
    title = Path(request.scenario).stem
    target = delivery.result_path(f"{title}-sweep")
    refuse_to_overwrite(target, force=delivery.force)
    with result_folder(target, force=delivery.force) as folder:
        if delivery.server is None:
            result = sweep_here(request, title, folder)
        else:
            from stridelab.cli.remote import run_remotely_as_is

            job_input = _remote_input(request)
            result = run_remotely_as_is("sweep", title, job_input, folder, delivery.server, delivery.token)
    show_swept(result, target, as_json=delivery.as_json)


def sweep_here(request: SweepRequest, title: str, folder: Path) -> JobResult:
    """Run the job's own function in this process, with its worker processes."""
    scenario = read_scenario(request.scenario)
    task = SweepTask(scenario=scenario, input=request.to_input(scenario))
    with progress_bar(title) as bar:
        bar(0.0, "starting")
        from stridelab.service.kinds.sweep import run as kind

        outcome = kind.run(task, folder, bar, request.processes)
    return write_result(folder, "sweep", task.input, outcome)


def _remote_input(request: SweepRequest) -> SweepInput:
    """Input for a server: a name that is neither a file nor bundled is taken as a scenario id."""
    try:
        return request.to_input(read_scenario(request.scenario))
    except NotFound:
        return request.to_input(None)


def show_swept(result: JobResult, target: Path, *, as_json: bool) -> None:
    """Print how many scenarios have a motion, and the ranges, or the result as JSON."""
    if as_json:
        show_json(result)
        return
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
