"""``stridelab plan``: runs the service's job here or on a service and writes a result folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer
from rich.markup import escape

from stridelab.cli.options import ControlOption, Delivery, Densities, NodeRate, ScenarioName, SolverOption
from stridelab.cli.results import deliver_result, out, run_kind, show_files, show_remarks, show_verdict
from stridelab.errors import Fault, InvalidInput, StridelabError
from stridelab.pipelines.scenarios.scenario_files import known_scenario, read_scenario
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.plans import (
    DURATION_RANGE,
    MAX_DELAY_S,
    MAX_DURATION_FACTOR,
    MAX_PRICE_PER_S,
    MIN_DURATION_FACTOR,
    PLAN_STAGES,
    TIME_LIMIT_S,
    CertificateCheck,
    Film,
    PlanMotionInput,
    PlanMotionSummary,
    PlanMotionTask,
    ReplayOptions,
    ReplaySummary,
    Shape,
)
from stridelab.schemas.scenarios import Scenario
from stridelab.service.local_runs import validate_options, write_result

if TYPE_CHECKING:
    from stridelab.client import Client

PAGE_FILE: Final = "motion.html"


@dataclass(frozen=True)
class PlanRequest:
    """Options of ``stridelab plan``; ``replay`` None means as ``whole_body``."""

    scenario: ScenarioName
    robot: Annotated[
        str | None,
        typer.Option("--robot", help="Scale a bundled scene, such as six-stairs, to this robot."),
    ] = None
    no_whole_body: Annotated[
        bool, typer.Option("--no-whole-body", help="Plan only the centre of mass and the contact forces.")
    ] = False
    replay: Annotated[
        bool | None,
        typer.Option("--replay/--no-replay", help="Replay the motion in physics; default unless --no-whole-body."),
    ] = None
    replay_delay_ms: Annotated[
        float,
        typer.Option(
            "--delay", "--replay-delay", min=0.0, max=1e3 * MAX_DELAY_S, help="Delay of the replay's control in ms."
        ),
    ] = 0.0
    expected_delay_ms: Annotated[
        float,
        typer.Option(
            "--expected-delay",
            min=0.0,
            max=1e3 * MAX_DELAY_S,
            help="Delay for which the replay's joint control allows, in ms.",
        ),
    ] = 0.0
    soft_gains: Annotated[
        bool, typer.Option("--soft-gains", help="Gains of the replay's joint control for 10 ms of delay.")
    ] = False
    pushes: Annotated[
        list[str] | None,
        typer.Option(
            "--push",
            help="TIME:X,Y,Z[:LINK], e.g. 3.2:0,20,0: seconds, impulse in N s, link (default: the trunk); repeatable.",
        ),
    ] = None
    payload_kg: Annotated[float, typer.Option("--payload", help="Mass added to the trunk in the replay, in kg.")] = 0.0
    friction: Annotated[float | None, typer.Option("--friction", help="Friction of all boxes in the replay.")] = None
    sensors: Annotated[
        Literal["true", "estimated"],
        typer.Option("--sensors", help="Input of the replay's stabiliser: the simulator's state, or an estimate."),
    ] = "true"
    measure: Densities = None
    formulation: ControlOption = "forces"
    solver: SolverOption = "auto"
    node_rate_hz: NodeRate = 10.0
    shape: Annotated[
        Shape | None,
        typer.Option("--shape", help="Forces between nodes: cubic splines or constant; splines for the whole body."),
    ] = None
    time_limit_s: Annotated[
        float | None, typer.Option("--time-limit", help="Seconds of processor time for the solver, at most 300.")
    ] = None
    free_durations: Annotated[
        bool, typer.Option("--free-durations", help="Let the solver optimise the duration of each phase.")
    ] = False
    duration_range: Annotated[
        tuple[float, float],
        typer.Option("--duration-range", help="Bounds on the durations, as multiples of the scenario's."),
    ] = DURATION_RANGE
    price_per_s: Annotated[
        float | None,
        typer.Option(
            "--time-price",
            min=0.0,
            max=MAX_PRICE_PER_S,
            help="With --free-durations: cost of a second of motion; the total duration is then free, too.",
        ),
    ] = None
    fastest: Annotated[
        bool,
        typer.Option("--fastest", help="Search the fastest pace at which the motion is certified and replayed."),
    ] = False
    film: Annotated[
        Film | None, typer.Option("--film", help="Also write a film of the motion: gif or mp4; needs ffmpeg.")
    ] = None
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Also write motion.mcap, a log that Foxglove and Rerun open.")
    ] = False

    def __post_init__(self) -> None:
        if self.replay and not self.whole_body:
            fault = Fault("--replay", "contradicts --no-whole-body")
            raise InvalidInput("option-invalid", "Only a motion of the whole body can be replayed.", [fault])
        disturbing = [name for name, given in self._disturbances.items() if given]
        if disturbing and not (self.whole_body if self.replay is None else self.replay):
            faults = [Fault(name, "needs a replay") for name in disturbing]
            raise InvalidInput("option-invalid", f"{', '.join(disturbing)}: only a replay can be disturbed.", faults)
        self.replay_options()
        if self.fastest and (self.pushes or not self.whole_body):
            fault = Fault("--fastest", f"contradicts {'--push' if self.pushes else '--no-whole-body'}")
            raise InvalidInput("option-invalid", "The pace is searched for a whole body without pushes.", [fault])
        if self.price_per_s is not None and not self.free_durations:
            fault = Fault("--time-price", "needs --free-durations")
            raise InvalidInput("option-invalid", "A price of time needs free durations.", [fault])
        if self.film is not None and not self.whole_body:
            fault = Fault("--film", "contradicts --no-whole-body")
            raise InvalidInput("option-invalid", "Only a motion of the whole body can be filmed.", [fault])
        if self.mcap and not self.whole_body:
            fault = Fault("--mcap", "contradicts --no-whole-body")
            raise InvalidInput("option-invalid", "Only a motion of the whole body has such a log.", [fault])
        if self.time_limit_s is not None and not 0.0 < self.time_limit_s <= TIME_LIMIT_S:
            fault = Fault("--time-limit", f"must be above 0 and at most {TIME_LIMIT_S:.0f} s")
            raise InvalidInput("option-invalid", f"The solver's time limit cannot be {self.time_limit_s:g} s.", [fault])
        cones = self.formulation == "circular-cones" and self.solver not in ("auto", "native")
        if self.free_durations and (self.solver == "fatrop" or cones):
            fault = Fault("--free-durations", "is for the C++ solver, or for ipopt with forces or wrench")
            named = "fatrop" if self.solver == "fatrop" else "circular cones"
            raise InvalidInput("option-invalid", f"Durations cannot be optimised with {named}.", [fault])
        if self.shape == "cubic" and (self.formulation == "wrench" or self.solver == "fatrop"):
            fault = Fault("--shape", "cubic is for forces, and not for fatrop")
            raise InvalidInput("option-invalid", "Forces cannot be cubic splines with these options.", [fault])
        least, most = self.duration_range
        if not (MIN_DURATION_FACTOR <= least <= 1.0 <= most <= MAX_DURATION_FACTOR):
            fault = Fault(
                "--duration-range", f"from {MIN_DURATION_FACTOR:g} to 1, and from 1 to {MAX_DURATION_FACTOR:g}"
            )
            message = f"Phases cannot last from {least:g} to {most:g} times their duration in the scenario."
            raise InvalidInput("option-invalid", message, [fault])

    @property
    def whole_body(self) -> bool:
        """Whether the motion of all joints is planned."""
        return not self.no_whole_body

    @property
    def _disturbances(self) -> dict[str, bool]:
        """Options that disturb the replay, and whether they are given."""
        return {
            "--delay": bool(self.replay_delay_ms),
            "--expected-delay": bool(self.expected_delay_ms),
            "--soft-gains": self.soft_gains,
            "--push": bool(self.pushes),
            "--payload": bool(self.payload_kg),
            "--friction": self.friction is not None,
            "--sensors": self.sensors != "true",
        }

    def replay_options(self) -> ReplayOptions | None:
        """Options of the replay; None without any. Raises ``InvalidInput`` (``option-invalid``)."""
        if not any(self._disturbances.values()):
            return None
        fields = {
            "delay_s": 1e-3 * self.replay_delay_ms,
            "expected_delay_s": 1e-3 * self.expected_delay_ms,
            "gains": "soft" if self.soft_gains else "stiff",
            "pushes": [parse_push(text) for text in self.pushes or ()],
            "payload_kg": self.payload_kg,
            "friction": self.friction,
            "sensors": self.sensors,
        }
        return validate_options(ReplayOptions, fields)

    @property
    def title(self) -> str:
        """Name of the scenario without folder and suffix."""
        return Path(self.scenario).stem

    def to_input(self, scenario: Scenario | None) -> PlanMotionInput:
        """Input of the job; without a scenario, the name is taken as a scenario id."""
        scenario_id = self.scenario if scenario is None else None
        replay = self.whole_body if self.replay is None else self.replay
        replay_options = self.replay_options() or replay
        return PlanMotionInput.from_object(self, scenario_id=scenario_id, scenario=scenario, replay=replay_options)


def parse_push(text: str) -> dict[str, Any]:
    """Fields of a push from ``TIME:X,Y,Z[:LINK]``. Raises ``InvalidInput`` (``option-invalid``)."""
    time_s, _, rest = text.partition(":")
    impulse, _, link = rest.partition(":")
    try:
        x, y, z = (float(part) for part in impulse.split(","))
        return {"time_s": float(time_s), "impulse_ns": (x, y, z), "link": link or None}
    except ValueError as error:
        fault = Fault("--push", f"{text} is not TIME:X,Y,Z[:LINK]")
        raise InvalidInput("option-invalid", f"{fault.message}, for example 3.2:0,20,0.", [fault]) from error


def plan_scenario(request: PlanRequest, delivery: Delivery) -> None:
    """Plan one motion here or on a server, write the result folder and show the summary.

    If the body cannot follow the plan, the folder holds the motion up to that time and the error is raised at the end.
    """
    failures: list[StridelabError | None] = []

    def compute_result(folder: Path) -> JobResult:
        server = delivery.server is not None
        result, failure = plan_there(request, folder, delivery) if server else plan_here(request, folder)
        failures.append(failure)
        return result

    deliver_result(f"{request.title}-plan", delivery, compute_result, show_plan)
    if failures[0] is not None:
        raise failures[0]


def plan_here(request: PlanRequest, folder: Path) -> tuple[JobResult, StridelabError | None]:
    """Run the job's own function in this process; ``folder`` then holds exactly what the service would publish.

    The second value is the error that left the motion incomplete, or None.
    """
    scenario = read_scenario(request.scenario) if request.robot is None else scale_here(request.scenario, request.robot)
    task = PlanMotionTask(scenario=scenario, input=request.to_input(scenario))
    outcome = run_kind("plan-motion", request.title, task, folder)
    return write_result(folder, "plan-motion", task.input, outcome), outcome.failure


def plan_there(request: PlanRequest, folder: Path, delivery: Delivery) -> tuple[JobResult, StridelabError | None]:
    """``plan_here`` on a server; a name that is neither a file nor bundled is taken as a scenario id."""
    from stridelab.cli.remote import run_remotely_or_fail

    given = known_scenario(request.scenario, on_service=True) if request.robot is None else None

    def prepare_input(client: "Client", _bar: object) -> PlanMotionInput:
        if request.robot is None:
            return request.to_input(given)
        return request.to_input(client.scaled_scene({"robot": request.robot, "scene": request.scenario}))

    return run_remotely_or_fail("plan-motion", request.title, prepare_input, folder, delivery, unprepared=InvalidInput)


def scale_here(scene: str, robot: str) -> Scenario:
    """The bundled ``scene`` for a robot of this machine. Raises as ``scene_for_robot`` and ``load_robot``."""
    from stridelab.pipelines.commissioning.robot_walker import walker_facts
    from stridelab.pipelines.scenarios.scaled_scenes import scene_for_robot
    from stridelab.robots.loader import load_robot

    return scene_for_robot(scene, robot, walker_facts(load_robot(robot)))


def show_plan(result: JobResult, target: Path) -> None:
    """Print the summary with certificate and replay."""
    summary = PlanMotionSummary.model_validate(result.summary)
    out.print(f"{escape(summary.scenario_name)}: {summary.duration_s:.1f} s in {summary.n_phases} phases")
    out.print(
        f"[bold]plan[/] converged in {summary.iterations} iterations and {summary.solve_time_s:.2f} s "
        f"({escape(summary.solver)}), objective {summary.objective:.4g}"
    )
    if summary.pace is not None:
        for attempt in summary.pace.attempts:
            outcome = "[green]passed[/]" if not attempt.reason else f"[red]failed[/] {escape(attempt.reason)}"
            out.print(f"  pace {attempt.pace:.2f}, {attempt.duration_s:.1f} s: {outcome}")
        cut = "" if summary.pace.finished else " (the search ran out of time)"
        out.print(f"[bold]fastest pace[/] {summary.pace.pace:.2f} of the given one{cut}")
    if summary.phase_durations is not None:
        chosen = ", ".join(f"{phase.chosen_s:.2f}" for phase in summary.phase_durations)
        out.print(f"[bold]durations chosen[/] {chosen} s")
    if summary.certificate is not None:
        width = max(len(check.name) for check in summary.certificate.checks)
        for check in summary.certificate.checks:
            out.print(_certificate_line(check, width))
        out.print("[green]certificate passed[/]" if summary.certificate.passed else "[red]certificate not passed[/]")
    if summary.stopped is not None:
        at = summary.stopped
        level = f"level {at.level} ({at.level_name}), {escape(', '.join(at.names))}"
        out.print(f"[bold red]stopped[/] at {at.time_s:.2f} s in phase {at.phase}: {level}")
    if summary.replay is not None:
        out.print(f"[bold]replay[/] {_describe_replay(summary.replay)}")
        for remark in summary.replay.remarks or ():
            if remark.code != "replay-fell":  # the line above says when
                out.print(f"  [yellow]{escape(remark.code)}[/] {escape(remark.message)}")
    if summary.stopped is None:
        show_verdict(result)
    times_s = {stage: summary.stage_times_s[stage] for stage in PLAN_STAGES if stage in summary.stage_times_s}
    out.print(f"[bold]took[/] {', '.join(f'{stage} {seconds:.1f} s' for stage, seconds in times_s.items())}")
    show_remarks(summary.warnings)
    show_files(result, target)
    if any(artifact.name == PAGE_FILE for artifact in result.artifacts):
        out.print(f"To see the motion, open {escape(str(target / PAGE_FILE))} in a browser.")


def _certificate_line(check: CertificateCheck, width: int) -> str:
    """Line of one check: outcome, name, worst value against its limit, and where it occurs."""
    verdict = "[green]passed[/]" if check.passed else "[bold red]failed[/]"
    unit = "" if check.unit == "1" else f" {check.unit}"
    value = f"{check.value:.4g} {'≥' if check.at_least else '≤'} {check.limit:.4g}{unit}"
    places = [
        f"phase {check.phase}" if check.phase is not None else "",
        check.effector or "",
        f"{check.time_s:.2f} s" if check.time_s is not None else "",
    ]
    where = ", ".join(place for place in places if place)
    return f"{verdict} {escape(check.name):<{width}} {escape(value):<27} {escape(where)}".rstrip()


def _describe_replay(replay: ReplaySummary) -> str:
    how = "completed" if replay.completed else "[bold red]not completed[/]"
    if replay.fall_time_s is not None:
        how = f"[bold red]fell[/] at {replay.fall_time_s:.1f} s"
    text = (
        f"{how}: CoM error {1e3 * replay.com_error_rms_m:.1f} mm RMS, {1e3 * replay.com_error_max_m:.1f} mm at most; "
        f"feet land up to {1e3 * replay.landing_error_max_m:.1f} mm off and slip "
        f"{1e3 * replay.foot_slip_max_m:.1f} mm; "
        f"torques up to {replay.torque_ratio_max:.0%} of their limits"
    )
    if replay.hand_force_mean_n is not None:
        text += f"; hand force {replay.hand_force_mean_n:.0f} N on average"
    if replay.left_plan is not None and replay.left_plan.arrived:
        text += (
            f"; left the plan at {replay.left_plan.time_s:.1f} s, went on at {replay.left_plan.resumed_s:.1f} s "
            "and reached its end"
        )
    if replay.options is not None:
        text += f"; disturbed: {escape(replay.options.description)}"
    return text
