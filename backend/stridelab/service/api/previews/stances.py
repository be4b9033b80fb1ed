"""Checks whether the whole body can reach the stances of a scenario, and move from one to the next.

Imported in the resident child process only.

The request contains the support regions of the scenario validation, so that they are not computed twice:

    {"ask": "stances", "robot": name, "posture_of": phase | null, "within_s": seconds | null,
     "scenario": the whole scenario if it is valid | null,
     "phases": [{"contacts": [...], "region_m": [[x, y], ...], "com_m": [x, y, z] | null}, ...]}
"""

import gc
import json
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, Final

import numpy as np

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.validation.validate import build_validated
from stridelab.dynamics.spatial import Placement
from stridelab.errors import StridelabError
from stridelab.pipelines.motion_check import MotionCheck
from stridelab.pipelines.plan_problem import load_densities, native_unavailable_reason
from stridelab.reachability.store import DEFAULT_MEASURE
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import link_poses
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.shoe_check import shoe_faults
from stridelab.wholebody.stance_check import Stance, StanceCheck, StanceResult, mid_swing_placement

Json = dict[str, Any]

TIME_LIMIT_S: Final = 4.0
"""Time limit of one request without its own; the phases that remain after it have no answer."""
SEARCH_S: Final = 0.04
"""Processor time of one search in a request; beyond it, and after the limit of the request, the search is paused."""
DIGITS: Final = 5


def answer_request(question: Json) -> Json:
    """Return ``{"phases": [...], "shoes": [...], "motion": "checked" | "unfinished" | null}``.

    ``phases`` are the fields of ``PhaseBody`` without its number, null for a phase not checked; ``shoes`` the faults of
    shoes without room, as ``where`` and ``message``. The motion is checked once all stances of a valid scenario are
    reachable, in a further request if a part of it does not fit after the searches of this one; a phase that the body
    cannot move through is ``unreachable``, too.

    The phase ``posture_of`` is checked first, then its neighbours. A request checks at least one phase that is not
    cached, unless its search takes long: it then goes on in the next request. Raises the errors of ``load_robot``.
    """
    until_s = time.monotonic() + (question.get("within_s") or TIME_LIMIT_S)
    check = _check_of(question["robot"])
    scenario = question.get("scenario")
    built, sequence, shoes = (None, None, []) if scenario is None else _built_sequence(json.dumps(scenario))
    stances = _cached_stances(question["robot"], json.dumps(question["phases"]))
    shown: int | None = question["posture_of"]
    order = sorted((k for k, stance in enumerate(stances) if stance is not None), key=lambda k: abs(k - (shown or 0)))
    answers: list[Json | None] = [None] * len(stances)
    searched = 0
    for k in order:
        stance = stances[k]
        if stance is None:
            continue
        is_cached = check.has_result(stance)
        if k != shown and not is_cached and searched and time.monotonic() > until_s:
            continue
        searched += not is_cached
        verdict = check.continue_search(stance, _search_limit(until_s))
        if verdict is not None:
            answers[k] = _stance_answer(check, verdict, shown=k == shown)
    motion = None
    are_reachable = all(one is not None and one["body"] == "reachable" for one in answers)
    if built is not None and sequence is not None and not shoes and are_reachable:
        is_late = bool(searched) and time.monotonic() + SEARCH_S > until_s
        motion = "unfinished" if is_late else _add_motion(built, sequence, answers, until_s)
    return {"phases": answers, "shoes": shoes, "motion": motion}


def _add_motion(
    scenario: Scenario, sequence: ContactSequence, answers: list[Json | None], until_s: float
) -> str | None:
    """Continue the motion check, and add its result to ``answers``; None if there is no C++ solver or no density."""
    motion_check = _motion_check_of(sequence.robot)
    if motion_check is None:
        return None
    results = motion_check.continue_check(scenario, sequence, _search_limit(until_s))
    if results is None:
        return "unfinished"
    for k, result in results.items():
        if not result.passed:
            why = {"reason": result.reason, "limits": list(result.limits), "contact": None}
            answers[k] = {**(answers[k] or {}), "body": "unreachable", **why}
    return "checked"


def _search_limit(until_s: float) -> Callable[[], bool]:
    """Whether a search that begins now has to be paused."""
    begun_s = time.process_time()
    return lambda: time.monotonic() > until_s and time.process_time() - begun_s > SEARCH_S


def stances_of(check: StanceCheck, phases: Sequence[Json]) -> list[Stance | None]:
    """The stance of each phase; None if its contacts are invalid or contain no sole."""
    placed = [_contact_placements(check, phase["contacts"]) for phase in phases]
    soles = [name for name, one in check.robot.effectors.items() if one.kind == "surface"]
    stances: list[Stance | None] = []
    for k, contacts in enumerate(placed):
        if contacts is None or not any(name in contacts for name in soles):
            stances.append(None)
            continue
        swing_poses = {}
        for name in soles:
            before = next((p[name] for p in reversed(placed[:k]) if p is not None and name in p), None)
            after = next((p[name] for p in placed[k + 1 :] if p is not None and name in p), None)
            place = None if name in contacts else mid_swing_placement(before, after)
            if place is not None:
                swing_poses[name] = place
        com_m = phases[k]["com_m"]
        region_m = np.array(phases[k]["region_m"], dtype=float).reshape(-1, 2)
        target_m = check.usual_com_m(contacts) if com_m is None else np.array(com_m, dtype=float)
        stances.append(Stance(contacts, target_m, region_m, swing_poses))
    return stances


@lru_cache(maxsize=4)
def _cached_stances(robot: str, phases: str) -> list[Stance | None]:
    """``stances_of`` the phases (JSON), which a drag sends several times."""
    return stances_of(_check_of(robot), json.loads(phases))


@lru_cache(maxsize=4)
def _built_sequence(scenario: str) -> tuple[Scenario, ContactSequence, list[Json]]:
    """A scenario (JSON) that has been validated, its sequence, and the faults of shoes that a plan is refused for."""
    body = json.loads(scenario)
    sequence = build_validated(body, effector_shapes(body["robot"]))
    faults = shoe_faults(_check_of(body["robot"]).robot, sequence)
    return (
        Scenario.model_validate(body),
        sequence,
        [{"where": fault.where, "message": fault.message} for fault in faults],
    )


@cache
def _check_of(robot: str) -> StanceCheck:
    return StanceCheck(load_robot(robot))


@cache
def _motion_check_of(robot: str) -> MotionCheck | None:
    if native_unavailable_reason() is not None:
        return None
    loaded = load_robot(robot)
    try:
        check = MotionCheck(loaded, load_densities(loaded, DEFAULT_MEASURE))
    except StridelabError:
        return None
    gc.freeze()  # what the process holds for good is not searched for garbage by every collection
    return check


def _contact_placements(check: StanceCheck, contacts: Sequence[Json]) -> Mapping[str, Placement] | None:
    placements: dict[str, Placement] = {}
    for contact in contacts:
        name = contact["effector"]
        if name not in check.robot.effectors or name in placements or not any(contact["orientation_wxyz"]):
            return None
        placements[name] = Placement.from_wxyz(contact["position_m"], contact["orientation_wxyz"])
    return placements


@lru_cache(maxsize=4)
def _rounded_poses(robot: Robot, q: bytes) -> list[list[float]]:
    """Poses of the links in a posture, which an editor asks for several times."""
    return list(np.round(link_poses(robot, np.frombuffer(q)), DIGITS).tolist())


def _stance_answer(check: StanceCheck, verdict: StanceResult, *, shown: bool) -> Json:
    poses = _rounded_poses(check.robot, verdict.q.tobytes()) if shown else None
    return {
        "body": "reachable" if verdict.reachable else "unreachable",
        "strained": verdict.strained,
        "reason": verdict.reason or None,
        "contact": verdict.contact,
        "limits": list(verdict.limits),
        "link_poses": poses,
    }
