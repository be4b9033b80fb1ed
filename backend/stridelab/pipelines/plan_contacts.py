"""From a stance, a goal stance and a terrain to a scenario with contacts (section 4.2).

Courses of obstacles, and terrains with a start and a goal, become such tasks.
"""

from collections.abc import Mapping
from typing import Any, Final

from stridelab.contacts.effector_geometry import EffectorShape, effector_shapes
from stridelab.contacts.planner.planner import ContactPlan, ContactPlanner
from stridelab.contacts.planner.schedule import Transition
from stridelab.contacts.planner.step_limits import heading_frame
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.course import Bar, Block, Course, Element, Flight, Gap, Level, Ramp, Stones
from stridelab.contacts.terrain import Box
from stridelab.contacts.terrain_meshes.crossing import crossing_task
from stridelab.contacts.validation.parse import parse_scenario
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.errors import InvalidInput, NotEstimable, StridelabError
from stridelab.pipelines.plan_motion import plan_motion, stage_shares
from stridelab.pipelines.progress import ProgressCallback, Stages
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.base import Remark
from stridelab.schemas.plans import PlanContactsInput, PlanContactsSummary, PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Course as CourseInput
from stridelab.schemas.scenarios import Scenario, TerrainCrossing

REFERENCES: Final = ("carpentier2017thesis", "deits2014footstep", "huangfu2018highs")
"""Citation keys of the method."""
PLAN_SHARE: Final = 0.2
"""Share of the progress taken by the first plan, if motions are computed."""
LEAST_UP: Final = 0.5
"""Smallest vertical part of the normal of an upper face on which a foot may be placed: 60 degrees."""
ELEMENTS: Final[Mapping[str, type[Any]]] = {
    "level": Level,
    "stairs": Flight,
    "ramp": Ramp,
    "stones": Stones,
    "bar": Bar,
    "box": Block,
    "gap": Gap,
}
"""Element of a course by the ``kind`` of its schema; the fields have the same names."""


def plan_contacts(request: PlanContactsInput, progress: ProgressCallback) -> PlanContactsSummary:
    """Plan the contacts of ``request``; the scenario of the summary passes the validation.

    With ``certify``, the motion of the plan is computed and certified. The step at which a certificate fails is
    forbidden in the next plan, and with it all that go as far in the same direction. If none passes, the scenario is
    the first one, of all plans the nearest to even steps.

    Raises ``InvalidInput`` (``stance-invalid``), ``NotEstimable`` (``contacts-unreachable``, ``contacts-too-far``,
    ``contact-plan-timeout``, ``contact-plan-refused``), and ``NotFound`` (``robot-not-found``,
    ``reachability-not-learned``).
    """
    progress(0.0, "reading the robot's reach")
    effectors = effector_shapes(request.robot)
    planner = ContactPlanner(effectors, planner_limits(request.robot))
    task = request.model_dump(mode="json", exclude={"certify"})
    share = PLAN_SHARE if request.certify else 1.0
    plan = planner.plan(task, lambda fraction, message: progress(share * fraction, message))
    certified: bool | None = None
    failures: list[str] = []
    if request.certify:
        plan, certified, failures = _certified_plan(planner, task, plan, request.certify, progress)
    report = validate_scenario(plan.scenario, effectors)
    return PlanContactsSummary.from_object(
        plan,
        scenario=Scenario.model_validate(plan.scenario),
        duration_s=report.duration_s,
        warnings=[Remark(code=remark.code, message=remark.message) for remark in report.remarks],
        certified=certified,
        failures=failures,
    )


def _certified_plan(
    planner: ContactPlanner, task: Mapping[str, Any], first: ContactPlan, most: int, progress: ProgressCallback
) -> tuple[ContactPlan, bool, list[str]]:
    """A plan with a certified motion, else ``first``; whether it is certified, and the failures of the plans before.

    At most ``most`` plans are tried; fewer if a failure has no phase, or no sequence of steps avoids the transitions.
    """
    plan, cuts, failures = first, list[Transition](), list[str]()
    for attempt in range(most):
        begun, share = PLAN_SHARE + (1 - PLAN_SHARE) * attempt / most, (1 - PLAN_SHARE) / most

        def report_attempt(fraction: float, message: str, begun: float = begun, share: float = share) -> None:
            progress(begun + share * fraction, message)

        scenario = Scenario.model_validate(plan.scenario)
        failure, phase = _certificate_failure(scenario, report_attempt)
        if not failure:
            return plan, True, failures
        failures.append(failure if phase is None else f"phases[{phase}]: {failure}")
        cut = None if phase is None else _transition_at(plan.scenario, planner, phase)
        if cut is None or attempt + 1 == most:
            break
        cuts.append(cut)
        try:
            plan = planner.plan(task, forbidden=cuts)
        except NotEstimable as error:
            failures.append(error.message)
            break
    return first, False, failures


def _certificate_failure(scenario: Scenario, progress: ProgressCallback) -> tuple[str, int | None]:
    """What prevents the motion of a scenario, empty if it is certified, and the phase."""
    request = PlanMotionInput(scenario=scenario)
    try:
        result = plan_motion(PlanMotionTask(scenario=scenario, input=request), Stages(progress, stage_shares(request)))
    except StridelabError as error:
        return f"{error.code}: {error.message}", None
    if result.stopped is not None:
        return f"{result.stopped.code}: {', '.join(result.stopped.names)}", result.stopped.phase
    failed = [check for check in result.certificate.checks if not check.passed] if result.certificate else []
    phases = [check.phase for check in failed if check.phase is not None]
    return ", ".join(check.name for check in failed), phases[0] if phases else None


def _transition_at(scenario: Mapping[str, Any], planner: ContactPlanner, phase: int) -> Transition | None:
    """The step of a phase: that of the swinging foot, else of the foot that landed last; None before the first one."""
    sequence, feet = sequence_of(scenario, planner.effectors), planner.limits.feet
    swings = [(k, foot) for k in range(phase + 1) for foot in feet if foot not in sequence.phases[k].contacts]
    if not swings:
        return None
    k, foot = swings[-1]
    landing = sequence.next_contact(foot, k)
    other = sequence.phases[k].contacts.get(next(name for name in feet if name != foot))
    if landing is None or other is None:
        return None
    axes = heading_frame(float(sequence.headings_rad[k]))
    ahead_m, left_m, _ = axes.T @ (landing.placement.position_m - other.placement.position_m)
    return Transition(foot, (float(ahead_m), float(left_m)))


def compose_course(request: CourseInput, effectors: Mapping[str, EffectorShape]) -> PlanContactsInput:
    """Compose the body of ``POST /jobs/plan-contacts``.

    Raises ``InvalidInput`` (``course-too-long``, ``course-without-hand``, ``course-without-feet``).
    """
    elements: list[Element] = [ELEMENTS[e.kind](**e.model_dump(exclude={"kind"})) for e in request.elements]
    sides = tuple(dict.fromkeys(request.handrails))
    task = Course(elements, sides, request.width_m).contact_task(effectors)
    head = {"robot": request.robot, "friction": request.friction, "name": request.name}
    return PlanContactsInput.model_validate({**head, **task})


def compose_crossing(request: TerrainCrossing, effectors: Mapping[str, EffectorShape]) -> PlanContactsInput:
    """Compose the body of ``POST /jobs/plan-contacts``; rails and walls stay in the terrain.

    Raises ``InvalidInput``: ``scenario-invalid`` naming surface and field, ``crossing-too-short``,
    ``terrain-without-foothold`` naming the end and the foot, and ``course-without-feet``.
    """
    head = {"robot": request.robot, "friction": request.friction, "name": request.name}
    surfaces = [surface.model_dump(mode="json", exclude_none=True) for surface in request.terrain]
    draft = parse_scenario({**head, "terrain": surfaces, "phases": []}, effectors)
    faults = [fault for fault in draft.faults if fault.where.startswith(("terrain", "friction"))]
    if faults:
        first = faults[0]
        text = f"The terrain cannot be crossed: {first.where}: {first.message}."
        raise InvalidInput("scenario-invalid", text, faults)
    floors = [_plain_box(box) for box in draft.terrain.boxes if box.placement.rotation[2, 2] > LEAST_UP]
    task = crossing_task(floors, request.start_m, request.goal_m, effectors)
    return PlanContactsInput.model_validate({**head, **task, "terrain": surfaces})


def _plain_box(box: Box) -> dict[str, Any]:
    return {
        "kind": "box",
        "name": box.name,
        "center_m": box.placement.position_m.tolist(),
        "size_m": box.size_m.tolist(),
        "orientation_wxyz": box.placement.wxyz.tolist(),
    }
