"""Random drags of a contact in the scenario editor: the editor's verdict, its processor time, and the complete plan.

A drag moves one contact of a bundled scenario along its surface, in all phases that have it, as the 3D view does; only
drags that the learned reachability accepts count. The editor's verdict is that of ``POST /scenarios/check`` with
``body_checked``, in one process without HTTP; limits of a request are processor time here, so that other processes
do not change what a request does.
"""

import copy
import time
from collections.abc import Coroutine, Mapping
from dataclasses import dataclass
from typing import Any, Final
from unittest import mock

import numpy as np

from stridelab.errors import StridelabError
from stridelab.pipelines.plan_motion import plan_motion, stage_shares
from stridelab.pipelines.progress import Stages
from stridelab.schemas.plans import PlanMotionInput, PlanMotionTask
from stridelab.schemas.scenarios import Scenario, ScenarioCheck
from stridelab.service.api.previews import stances
from stridelab.service.api.scenarios.bodies import add_body_checks
from stridelab.service.api.scenarios.validation import _cached_check, validate_sync
from stridelab.service.samples.scenarios import bundled_scenarios

ROBOTS: Final = ("talos", "hrp2")
LATER_SCENES: Final = frozenset({"house-stairs", "outdoor-stairs"})
"""Not drawn: a seed is the drag that it was when the measurements of the docs were made, without these scenes."""
MAX_DRAG_M: Final = 0.9
SAME_PLACE_M: Final = 1e-6
REQUEST_S: Final = 0.03
"""Time of one request of the editor for phases that are not cached."""
MAX_REQUESTS: Final = 400


@dataclass(frozen=True)
class Drag:
    """A scenario after a drag of ``effector``, and a phase of the contact, whose posture the editor shows."""

    robot: str
    seed: int
    scene: str
    effector: str
    phase: int
    scenario: Mapping[str, Any]


@dataclass(frozen=True)
class EditorVerdict:
    """Verdict of the editor, and processor times (s) of the first answer, of all requests and of the longest one.

    ``stances`` is the verdict without the motion between stances.
    """

    valid: bool
    stances: bool
    reason: str
    first_s: float
    complete_s: float
    longest_s: float
    requests: int


@dataclass(frozen=True)
class PlanVerdict:
    """Whether the complete plan is certified; otherwise the stage that fails and why."""

    certified: bool
    stage: str
    reason: str


def draw_drag(robot: str, seed: int) -> Drag:
    """The first accepted drag of ``robot`` with this seed."""
    rng = np.random.default_rng([seed, ROBOTS.index(robot)])
    scenes = {name: body for name, body in bundled_scenarios().items() if body["robot"] == robot}
    drawn = sorted(scenes.keys() - LATER_SCENES)
    while True:
        scene = str(rng.choice(drawn))
        scenario = copy.deepcopy(scenes[scene])
        k = int(rng.integers(len(scenario["phases"])))
        chosen = scenario["phases"][k]["contacts"][int(rng.integers(len(scenario["phases"][k]["contacts"])))]
        angle, length_m = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, MAX_DRAG_M)
        _move_contact(scenario, chosen, length_m * np.array([np.cos(angle), np.sin(angle), 0.0]))
        if validate_sync(Scenario.model_validate(scenario)).valid:
            return Drag(robot, seed, scene, chosen["effector"], k, scenario)


def _move_contact(scenario: dict[str, Any], chosen: Mapping[str, Any], by_m: np.ndarray) -> None:
    """Move a contact by ``by_m`` in its own axes, in all phases that have it."""
    effector, place_m = chosen["effector"], np.array(chosen["position_m"])
    w, *axis = chosen["orientation_wxyz"]
    moved_m = by_m + 2.0 * np.cross(axis, np.cross(axis, by_m) + w * by_m)
    for phase in scenario["phases"]:
        for contact in phase["contacts"]:
            same = np.allclose(contact["position_m"], place_m, atol=SAME_PLACE_M)
            if contact["effector"] == effector and same:
                contact["position_m"] = (place_m + moved_m).tolist()


def open_scenes(robot: str) -> None:
    """Check the bundled scenarios of ``robot``, as an editor does with a scenario that is opened."""
    for scene, scenario in bundled_scenarios().items():
        if scenario["robot"] == robot:
            check_drag(Drag(robot, 0, scene, "", 0, scenario))


def check_drag(drag: Drag) -> EditorVerdict:
    """Send the scenario until its verdict is complete."""
    _cached_check.cache_clear()  # of the draw, which validates it as well
    times_s: list[float] = []
    answer: dict[str, Any] = {"phases": [], "shoes": [], "motion": None}

    async def ask_body(_robot: str, question: dict[str, Any]) -> dict[str, Any]:
        nonlocal answer
        answer = stances.answer_request(question)
        return answer

    with mock.patch.object(stances, "time", _ProcessorClock):
        for _ in range(MAX_REQUESTS):
            started_s = time.process_time()
            scenario = Scenario.model_validate(drag.scenario)
            checked = add_body_checks(scenario, validate_sync(scenario), ask_body, drag.phase, REQUEST_S)
            check = _run_once(checked)
            times_s.append(time.process_time() - started_s)
            if all(answer["phases"]) and answer["motion"] != "unfinished":
                break
    reason = "; ".join(fault.message for fault in check.errors)
    stand = answer["motion"] == "checked"
    return EditorVerdict(check.valid, stand, reason, times_s[0], sum(times_s), max(times_s), len(times_s))


def _run_once(checked: Coroutine[Any, Any, ScenarioCheck]) -> ScenarioCheck:
    """The result of a coroutine that waits for nothing, without the costs of an event loop."""
    try:
        checked.send(None)
    except StopIteration as end:
        result: ScenarioCheck = end.value
        return result
    raise AssertionError("nothing in it waits")


class _ProcessorClock:
    """Stands in for ``time``: a deadline on the wall clock becomes one in processor time."""

    monotonic = process_time = staticmethod(time.process_time)


def plan_drag(drag: Drag) -> PlanVerdict:
    """Complete plan and certificate of a drag with the defaults of ``plan-motion``."""
    scenario = Scenario.model_validate(drag.scenario)
    request = PlanMotionInput(scenario=scenario)
    stages = Stages(lambda _fraction, _message: None, stage_shares(request))
    try:
        planned = plan_motion(PlanMotionTask(scenario=scenario, input=request), stages)
    except StridelabError as error:
        return PlanVerdict(False, error.faults[-1].where if error.faults else "", error.message)
    if planned.stopped is not None:
        return PlanVerdict(False, "whole body", planned.stopped.message)
    certificate = planned.certificate
    assert certificate is not None
    if certificate.passed:
        return PlanVerdict(True, "", "")
    failed = [
        f"{one.name} {one.value:.4g} {one.unit} ({one.limit:g}), phase {one.phase}, {one.effector}"
        for one in certificate.checks
        if not one.passed
    ]
    return PlanVerdict(False, "certificate", "; ".join(failed))
