"""Motion check: whether the whole body can follow the plan of a scenario between its stances, while it is edited.

The plan is that of ``plan-motion``, of the changed phases and ``PADDING`` phases on both sides. The whole-body
controller follows it with the same tasks, limits and collision pairs at ``RATE_HZ``, in place of 250 Hz. Phases whose
contacts, swings or durations have changed since they were checked are followed; the body starts on their contacts with
a posture on the CoM of the plan, at its speed. Self-collisions and distances from the terrain are measured as in the
certificate, the CoM error with a larger limit. What depends on the rate (drift of contacts, landings)
and the agreement of the angular momenta is left to the plan.
"""

from collections import OrderedDict
from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.hand_force_limits import hand_bounds_n
from stridelab.centroidal.nlp.solvers import Limits
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.errors import InvalidInput, NotEstimable, StridelabError
from stridelab.pipelines.plan_problem import control_of
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.part_names import part_words
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import SelfCollision
from stridelab.schemas.plans import PlanMotionInput
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.certificate.certificate import Check
from stridelab.wholebody.certificate.clearance import self_collision, terrain_distances, thin_samples
from stridelab.wholebody.control.collision_avoidance import AvoidanceSettings, CollisionAvoidance
from stridelab.wholebody.control.controller import ControllerRun, WholeBodyController
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.leg_stretch import iterate_lower_plans
from stridelab.wholebody.motion import WholeBodyMotion, WholeBodyStopped

RATE_HZ: Final = 50.0
COM_ERROR_M: Final = 2e-3
"""Largest CoM error; four times that of the certificate, since the integration of this rate contributes to it."""
SAMPLES: Final = 10
"""Samples between two points at which a check can be paused."""
EVERY: Final = 2
"""Distances are measured in every second sample, every 40 ms as in the certificate."""
SETTLING_S: Final = 0.5
"""Time in which bodies that the first posture of a later phase puts into each other are separated."""
MAX_PAUSED: Final = 4
MAX_TERRAINS: Final = 16
"""Terrains whose pairs of shapes are stored, some 0.3 MB each."""
PADDING: Final = 2
"""Phases before and after those that are followed in the plan, which begins and ends at rest."""
CACHE_SIZE: Final = 4096
AT_LIMIT_SHARE: Final = 0.93
"""Share of a torque limit or of half a joint's range from which a joint is named as the cause."""
NOT_FOLLOWED: Final = "the body cannot follow the plan"
LIMITS: Final = Limits(iterations=100, cpu_s=2.0)
"""Limits of the solver, as for a preview."""


@dataclass(frozen=True)
class MotionResult:
    """Whether the body can move through a phase; otherwise ``reason`` and the exhausted ``limits``."""

    passed: bool
    reason: str = ""
    limits: tuple[str, ...] = ()


PASSED: Final = MotionResult(True)
Results = Mapping[int, MotionResult]


class MotionCheck:
    """Motion check of one robot, with caches of phases that passed and of plans that failed. Not thread-safe."""

    def __init__(self, robot: Robot, proxies: Mapping[str, Proxy]) -> None:
        self.robot = robot
        self._proxies = proxies
        self._limits = JointLimits.of_model(robot.model)
        self._collision = SelfCollision(robot, all_shapes=True)
        self._passed: OrderedDict[bytes, None] = OrderedDict()
        self._failed: OrderedDict[bytes, Results] = OrderedDict()
        self._paused: OrderedDict[bytes, Generator[None, None, None]] = OrderedDict()
        self._avoidances: OrderedDict[str, CollisionAvoidance] = OrderedDict()
        self._hand_bounds_n: dict[bytes, float] = {}
        self._latest: tuple[ContactSequence, list[bytes]] | None = None

    def continue_check(
        self, scenario: Scenario, sequence: ContactSequence, is_over: Callable[[], bool]
    ) -> Results | None:
        """Check all phases of a valid scenario until ``is_over``; None if there is no result until then.

        A check that is not over goes on in the next call with the same scenario. After the first phase that fails no
        further one is checked; those have no result.
        """
        if self._latest is None or self._latest[0] is not sequence:
            self._latest = sequence, _phase_keys(sequence)
        keys = self._latest[1]
        whole = b"".join(keys)
        failing = self._known_failure(sequence, keys)
        if not failing and not all(key in self._passed for key in keys):
            search = self._paused.pop(whole, None) or self._check_phases(scenario, sequence, keys)
            for _ in search:
                if is_over():
                    self._paused[whole] = search
                    if len(self._paused) > MAX_PAUSED:
                        self._paused.popitem(last=False)
                    return None
            failing = self._known_failure(sequence, keys)
        passed = [k for k, key in enumerate(keys) if key in self._passed]
        for k in passed:
            self._passed.move_to_end(keys[k])
        while len(self._passed) > max(CACHE_SIZE, len(keys)):
            self._passed.popitem(last=False)
        return dict.fromkeys(passed, PASSED) | dict(failing)

    def _known_failure(self, sequence: ContactSequence, keys: list[bytes]) -> Results:
        """The results of a plan of which it is known that it fails: its last phase; empty if none is known."""
        for first, last in self._open_spans(keys):
            begin, end = _planned_span(sequence, first, last)
            failed = self._failed.get(b"".join(keys[begin:end]))
            if failed is not None:
                return {begin + k: result for k, result in failed.items()}
        return {}

    def _record_failure(self, planned: list[bytes], starts: int, phase: int, result: MotionResult) -> None:
        """Store that the plan of the phases ``planned``, followed from ``starts`` on, fails in ``phase``.

        The key has all of them, since with other neighbours the same phase may pass.
        """
        self._failed[b"".join(planned)] = dict.fromkeys(range(starts, phase), PASSED) | {phase: result}
        if len(self._failed) > CACHE_SIZE:
            self._failed.popitem(last=False)

    def _open_spans(self, keys: list[bytes]) -> list[tuple[int, int]]:
        """First and last phase of every run of phases that have not passed."""
        edges = np.flatnonzero(np.diff([False, *(key not in self._passed for key in keys), False]))
        return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]

    def _check_phases(
        self, scenario: Scenario, sequence: ContactSequence, keys: list[bytes]
    ) -> Generator[None, None, None]:
        """Plan and follow each run of phases without a result; pauses after every part."""
        for first, last in self._open_spans(keys):
            begin, end = _planned_span(sequence, first, last)
            part = replace(
                sequence,
                phases=sequence.phases[begin:end],
                start_com_height_m=sequence.start_com_height_m if begin == 0 else None,
            )
            plan = None
            for step in self._plan_steps(scenario, part):
                plan = step
                yield
            if not isinstance(plan, CentroidalPlan):
                reason = f"there is no plan for the centre of mass: {plan}"
                self._record_failure(keys[begin:end], first - begin, first - begin, MotionResult(False, reason))
                return
            failed = None
            starts = 0 if first - begin <= 1 and begin == 0 else first - begin
            for found in self._follow_steps(plan, starts, last - begin):
                failed = found
                yield
            if failed:
                self._record_failure(keys[begin:end], starts, *failed)
                return
            self._passed.update(dict.fromkeys(keys[begin + starts : last + 1]))

    def _plan_steps(
        self, scenario: Scenario, sequence: ContactSequence
    ) -> Generator[CentroidalPlan | StridelabError | None, None, None]:
        """The plan of ``plan-motion`` in parts; the last part is the plan or the reason why there is none."""
        robot, request = self.robot, PlanMotionInput(scenario=scenario)
        control = control_of(request)
        bounds_n = hand_bounds_n(robot, sequence, self._hand_bounds_n) if control.has_point_forces else {}
        yield None
        posed = from_rest_to_rest(robot, sequence, self._proxies)
        problem = replace(posed, control=control, bounds=PathBounds(None, bounds_n), node_rate_hz=request.node_rate_hz)
        smooth = replace(problem, shape="cubic")
        plan = solve(smooth, "native", LIMITS)
        if plan.converged:
            problem = smooth
        else:
            yield None
            plan = solve(problem, "native", LIMITS)
        if not plan.converged:
            yield NotEstimable("plan-not-converged", plan.status)
            return
        yield None
        try:
            for _, lower in iterate_lower_plans(robot, problem, plan, partial(solve, solver="native")):
                yield lower
        except InvalidInput as error:  # a foot that lifts off and lands nowhere, which plan-motion refuses as well
            yield error

    def _first_fault(
        self, sequence: ContactSequence, motion: WholeBodyMotion, new: slice
    ) -> tuple[int, MotionResult] | None:
        """The phase and the reason of the first fault in the samples ``new``, apart from distances of the terrain."""
        time_s, q = motion.time_s[new], motion.q[new]
        phase = sequence.phases_at(time_s + 1e-9)
        error_m = np.linalg.norm(motion.com_m[new] - motion.com_reference_m[new], axis=1)
        far = np.flatnonzero(~(error_m <= COM_ERROR_M))
        if len(far):
            joints = self._joints_at_limit(q[far[0]], motion.tau_nm[new][far[0]])
            at = f", with {' and '.join(_words_of_limit(name) for name in joints)} at its limit" if joints else ""
            away = f"{1e3 * error_m[far].max():.1f} mm from its plan, {1e3 * COM_ERROR_M:g} are allowed"
            reason = f"{NOT_FOLLOWED}: the centre of mass is {away}{at}"
            return int(phase[far[0]]), MotionResult(False, reason, tuple(_joint_of_limit(name) for name in joints))
        settled = 0 if not motion.time_s[0] else int(np.searchsorted(time_s, motion.time_s[0] + SETTLING_S))
        chosen, worst = thin_samples(time_s[settled:], phase[settled:], EVERY)
        return _fault_of([self_collision(self.robot, q[settled:][chosen], worst, self._collision)])

    def _joints_at_limit(self, q: Float[np.ndarray, "nq"], tau_nm: Float[np.ndarray, "na"]) -> list[str]:
        """Up to three limits, as "range of joint" or "torque of joint", those that are used most first."""
        limits = self._limits
        middle, half = 0.5 * (limits.upper_rad + limits.lower_rad), 0.5 * (limits.upper_rad - limits.lower_rad)
        used = np.r_[np.abs(tau_nm) / limits.torque_nm, np.abs(q[7:] - middle) / half]
        names = [f"{kind} of {joint}" for kind in ("torque", "range") for joint in self.robot.joint_names]
        order = np.argsort(-used, kind="stable")[:3]
        return [f"{names[k]} ({100 * used[k]:.0f} %)" for k in order.tolist() if used[k] >= AT_LIMIT_SHARE]

    def _follow_steps(
        self, plan: CentroidalPlan, first: int, last: int
    ) -> Generator[tuple[int, MotionResult] | None, None, None]:
        """Follow the plan through the phases ``first`` to ``last``; the last part is the phase that fails, or None."""
        robot, sequence, controller = self.robot, plan.sequence, WholeBodyController(rate_hz=RATE_HZ)
        avoidance = self._take_avoidance(sequence.terrain)
        try:
            run = ControllerRun(controller, robot, sequence, plan, span=(first, last), avoidance=avoidance)
            yield None
            checked = 0
            for i in range(len(run.times)):
                run.run_sample(i)
                if (i + 1) % SAMPLES == 0 or i + 1 == len(run.times):
                    failed = self._first_fault(sequence, run.recorded_motion(0.0), slice(checked, i + 1))
                    checked = i + 1
                    yield failed
                    if failed:
                        return
            motion = run.recorded_motion(0.0)
            chosen, worst = thin_samples(motion.time_s, sequence.phases_at(motion.time_s + 1e-9), EVERY)
            yield _fault_of(terrain_distances(robot, sequence, motion.q[chosen], worst, tolerance_m=0.0))
        except WholeBodyStopped as stop:
            limits = ", ".join(_words_of_limit(name) for name in stop.names)
            reason = f"{NOT_FOLLOWED}; at its limit: {limits}"
            yield stop.phase, MotionResult(False, reason, tuple(_joint_of_limit(name) for name in stop.names))
        except NotEstimable as error:
            yield first, MotionResult(False, error.message)
        finally:
            self._avoidances[repr(sequence.terrain)] = avoidance
            if len(self._avoidances) > MAX_TERRAINS:
                self._avoidances.popitem(last=False)

    def _take_avoidance(self, terrain: Terrain) -> CollisionAvoidance:
        """The pairs of an earlier run on the same terrain, or new ones; no other run gets them until they are back."""
        avoidance = self._avoidances.pop(repr(terrain), None)
        if avoidance is None:
            return CollisionAvoidance(self.robot, terrain, AvoidanceSettings())
        avoidance.begin_run()
        return avoidance


def _fault_of(checks: Iterable[Check]) -> tuple[int, MotionResult] | None:
    for check in checks:
        if not check.passed:
            limits = tuple((check.effector or "").split(" and "))
            return check.phase or 0, MotionResult(False, _sentence_of(check), limits)
    return None


def _joint_of_limit(name: str) -> str:
    return name.rpartition(" of ")[2].partition(" (")[0]


def _words_of_limit(name: str) -> str:
    """A limit in words: "torque of left knee (97 %)" for "torque of leg_left_4_joint (97 %)"."""
    kind, of, rest = name.rpartition(" of ")
    joint, space, share = rest.partition(" (")
    return f"{kind}{of}{part_words(joint)}{space}{share}"


def _sentence_of(check: Check) -> str:
    parts = [part_words(one) for one in (check.effector or "").split(" and ")]
    if check.name == "self_collision_pairs":
        return f"in motion the {parts[0]} is inside the {parts[-1]}"
    return (
        f"in motion the {parts[0]} is {1e3 * check.value:.1f} mm from the terrain, {1e3 * check.limit:g} are required"
    )


def _planned_span(sequence: ContactSequence, first: int, last: int) -> tuple[int, int]:
    """The phases that are planned, ``PADDING`` on both sides, and more until no effector swings there."""
    n = len(sequence.phases)
    begin, end = max(first - PADDING, 0), min(last + 1 + PADDING, n)
    while begin > 0 and _has_swing(sequence, begin):
        begin -= 1
    while end < n and _has_swing(sequence, end - 1):
        end += 1
    return begin, end


def _has_swing(sequence: ContactSequence, phase: int) -> bool:
    """Whether an effector moves from one contact to another in ``phase``."""
    return any(
        name not in sequence.phases[phase].contacts
        and sequence.last_contact(name, phase) is not None
        and sequence.next_contact(name, phase) is not None
        for name in sequence.effectors
    )


def _phase_keys(sequence: ContactSequence) -> list[bytes]:
    """One key per phase: equal if its contacts, the ends of its swings and its duration agree to a tenth of a mm."""
    terrain = repr(sequence.terrain).encode()
    of_contact: dict[int, bytes] = {}

    def contact_bytes(contact: Contact | None) -> bytes:
        if contact is None:
            return b"-"
        if id(contact) not in of_contact:
            place = contact.placement
            numbers = np.round(np.r_[place.position_m, place.rotation.ravel(), contact.friction], 4)
            of_contact[id(contact)] = numbers.tobytes() + contact.surface.encode()
        return of_contact[id(contact)]

    own = []
    for k, phase in enumerate(sequence.phases):
        parts = [b"%.6f" % phase.duration_s]
        for name in sequence.effectors:
            ends = [phase.contacts.get(name)]
            if ends[0] is None:
                ends = [sequence.last_contact(name, k), sequence.next_contact(name, k)]
            parts += [name.encode(), *map(contact_bytes, ends)]
        own.append(b"".join(parts))
    rest = [k in (0, len(own) - 1) for k in range(len(own))]
    return [sha256(b"".join((terrain, own[k], b"%d" % rest[k]))).digest() for k in range(len(own))]
