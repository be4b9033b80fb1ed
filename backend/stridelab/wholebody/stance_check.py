"""Stance check: whether the whole body can reach the contacts of a phase, by inverse kinematics.

A stance is reachable if a posture exists with every contact of the phase, the CoM above the support region and within
the learned reach of every contact, every joint inside the range that the whole-body stage uses, and no self-collision.
Feet in the air are placed at mid-swing, or beside the other foot, so that the legs do not cross. For a posture with
self-collisions the search is repeated with tasks that separate the colliding shapes.

The search is local. It starts at the reference posture over the contacts and then at a fixed list of others, so that
the result depends on the stance only, not on earlier calls or neighbouring phases, and can be cached. "Unreachable"
means that no start led to a posture, which is not a proof.

The check does not cover the motion between stances: the plan verifies speeds, torques and swings.
"""

from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.inverse_kinematics import ComRegion, IkResult, reference_posture_at, stand_in_com_region
from stridelab.robots.part_names import part_words
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import PairSeparation, SelfCollision
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.task_stack import Settings

RANDOM_STARTS: Final = 4
"""Number of random start postures besides the reference posture."""
MAX_SEPARATIONS: Final = 3
"""Maximum number of repeated searches that separate colliding shapes."""
MAX_SOLVES: Final = 12
"""Number of solves after which no further start is tried."""
LOWER_M: Final = (0.08, 0.16)
"""Lowering of the CoM target in further searches."""
MAX_FIRST_ERROR_M: Final = 0.05
"""Error of the first searches beyond which no further start is tried."""
SPREAD_RAD: Final = 0.25
LIFT_M: Final = 0.06
"""Height of a swinging foot above the higher of its two contacts."""
CACHE_SIZE: Final = 4096
MAX_PAUSED: Final = 16
"""Number of unfinished searches that can be continued."""
FAULT_SHARE: Final = 0.3
"""Contacts with less than this share of the largest error are not reported as the cause."""
MIN_REPORTED_ERROR_M: Final = 5e-4
"""Position errors below this are reported as orientation errors."""
UNREACHABLE: Final = "the body cannot take this stance"
CENTRE_OF_MASS: Final = "centre of mass"


@dataclass(frozen=True, eq=False)
class Stance:
    """The contacts of one phase by effector (``T_world_contact``), and the placements of feet in the air.

    ``region_m`` ``(k, 2)`` is the support region, counter-clockwise, empty if the CoM is not restricted; ``com_m`` is
    the preferred CoM within it.
    """

    contacts: Mapping[str, Placement]
    com_m: Vector3
    region_m: Float[np.ndarray, "k 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    air: Mapping[str, Placement] = field(default_factory=dict)

    @cached_property
    def cache_key(self) -> tuple[object, ...]:
        """Cache key: equal for stances that agree to a tenth of a millimetre."""
        return (
            *((name, _rounded_bytes(p)) for name, p in sorted(self.contacts.items())),
            "air",
            *((name, _rounded_bytes(p)) for name, p in sorted(self.air.items())),
            np.round(self.com_m, 4).tobytes(),
            np.round(self.region_m, 4).tobytes(),
        )


@dataclass(frozen=True, eq=False)
class StanceResult:
    """Whether the body can reach a stance; ``q`` ``(nq,)`` is the posture, or the one with the smallest error.

    ``reason`` describes the cause in a sentence, ``limits`` lists the effectors, joints or links involved; both are
    empty for a reachable stance. ``strained`` stances needed separated limbs or another start: the whole-body stage,
    which does neither, rarely passes them. ``contact`` is the contact with the largest error, None if contacts are not
    the cause.
    """

    reachable: bool
    q: Float[np.ndarray, "nq"]
    strained: bool = False
    reason: str = ""
    limits: tuple[str, ...] = ()
    contact: str | None = None


class _Attempt(NamedTuple):
    """One search: placements, CoM target, start (None is the reference posture).

    Attempts with ``second`` are skipped if the first ones miss by far.
    """

    placements: Mapping[str, Placement]
    com_m: Vector3
    q_start: Float[np.ndarray, "nq"] | None = None
    second: bool = False


class StanceCheck:
    """Stance check of one robot with a cache of results. Not thread-safe: the collision check has buffers."""

    def __init__(self, robot: Robot) -> None:
        settings = Settings()
        self.robot = robot
        self._margins_rad = JointLimits.of_model(robot.model).margins_rad(
            settings.range_share, settings.joint_margin_rad
        )
        self._collision = SelfCollision(robot)
        self._cache: OrderedDict[tuple[object, ...], StanceResult] = OrderedDict()
        self._paused: OrderedDict[tuple[object, ...], Generator[None, None, StanceResult]] = OrderedDict()
        self._soles = tuple(name for name, one in robot.effectors.items() if one.kind == "surface")
        self._shapes = effector_shapes(robot.name)
        data = robot.model.createData()
        self._height_m = float(pin.centerOfMass(robot.model, data, robot.q_reference)[2])
        self._apart = _sole_offsets(robot, self._soles)

    def usual_com_m(self, contacts: Mapping[str, Placement]) -> Vector3:
        """CoM above the mean of the soles, at the height of the reference posture."""
        soles = [place.position_m for name, place in contacts.items() if name in self._soles]
        x, y, z = np.mean(soles, axis=0)
        return np.array([x, y, z + self._height_m])

    def has_result(self, stance: Stance) -> bool:
        """Whether the result of ``stance`` is cached."""
        return stance.cache_key in self._cache

    def check_stance(self, stance: Stance) -> StanceResult:
        """Check ``stance``. Raises ``InvalidInput`` (``effector-unknown``)."""
        result = self.continue_search(stance, lambda: False)
        if result is None:
            raise AssertionError("a search without an end has a result")
        return result

    def continue_search(self, stance: Stance, is_over: Callable[[], bool]) -> StanceResult | None:
        """Check ``stance`` until ``is_over``, evaluated between two solves of about 10 ms each.

        None if there is no result until then; the search goes on in the next call with the same stance. Raises as
        ``check_stance``.
        """
        key = stance.cache_key
        result = self._cache.get(key)
        if result is None:
            search = self._paused.pop(key, None) or self._search_posture(stance)
            result = _advance_search(search, is_over)
            if result is None:
                self._paused[key] = search
                if len(self._paused) > MAX_PAUSED:
                    self._paused.popitem(last=False)
                return None
            self._cache[key] = result
            if len(self._cache) > CACHE_SIZE:
                self._cache.popitem(last=False)
        self._cache.move_to_end(key)
        return result

    def _search_posture(self, stance: Stance) -> Generator[None, None, StanceResult]:
        """Search for a posture; can be paused before every solve but the first."""
        room = self._com_region(stance)
        best_miss: IkResult | None = None
        best_collision: tuple[IkResult, tuple[int, ...]] | None = None
        solves = 0
        for attempt in self._search_attempts(stance):
            far = best_collision is None and best_miss is not None and _ik_error(best_miss) > MAX_FIRST_ERROR_M
            if attempt.second and (far or solves >= MAX_SOLVES):
                break
            placements, q_start = attempt.placements, attempt.q_start
            separated: tuple[int, ...] = ()
            for _ in range(1 + MAX_SEPARATIONS):
                if solves:
                    yield
                separation = PairSeparation(self.robot, self._collision.hulls, separated) if separated else None
                posture = stand_in_com_region(
                    self.robot, placements, room, attempt.com_m, q_start, self._margins_rad, separation
                )
                solves += 1
                if not posture.converged:
                    break
                pairs = self._collision.colliding_indices(posture.q)
                if not pairs:
                    return StanceResult(True, posture.q, attempt.second or bool(separated))
                if best_collision is None or len(pairs) < len(best_collision[1]):
                    best_collision = (posture, pairs)
                q_start, separated = posture.q, tuple(sorted({*separated, *pairs}))
            if (
                not separated
                and len(placements) == len(stance.contacts)
                and (best_miss is None or _ik_error(posture) < _ik_error(best_miss))
            ):
                best_miss = posture
        if best_collision is not None:
            return self._collision_result(*best_collision)
        if best_miss is None:
            raise RuntimeError("no search used the contacts alone")
        return self._unreachable_result(stance, best_miss)

    def _com_region(self, stance: Stance) -> ComRegion:
        """CoM region: above the support region and within the learned reach of every contact."""
        room = ComRegion.over_polygon(stance.region_m)
        A, b = [room.A], [room.b]
        for name, place in stance.contacts.items():
            shape = self._shapes.get(name)
            if shape is None or shape.reach is None:
                continue
            axes, origin = place.rotation.T, place.rotation.T @ place.position_m
            A += [axes, -axes]
            b += [np.array(shape.reach.com_high_m) + origin, -np.array(shape.reach.com_low_m) - origin]
        return ComRegion(np.vstack(A), np.concatenate(b))

    def _search_attempts(self, stance: Stance) -> Iterator[_Attempt]:
        contacts, com_m = stance.contacts, stance.com_m
        beside = {name: p for name in self._soles if name not in contacts and (p := self._next_to(name, contacts))}
        for free in (stance.air, beside):
            if free:
                yield _Attempt({**contacts, **free}, com_m)
        yield _Attempt(contacts, com_m)
        placements = {**contacts, **beside}
        for lower_m in LOWER_M:
            yield _Attempt(placements, com_m - [0.0, 0.0, lower_m], second=True)
        rng = np.random.default_rng(0)
        reference = reference_posture_at(self.robot, contacts, com_m)
        for _ in range(RANDOM_STARTS):
            yield _Attempt(placements, com_m, self._perturbed_posture(reference, rng), second=True)

    def _perturbed_posture(self, q: Float[np.ndarray, "nq"], rng: np.random.Generator) -> Float[np.ndarray, "nq"]:
        """Add normal noise to all angles and clip them to their ranges."""
        model = self.robot.model
        noise = SPREAD_RAD * rng.standard_normal(model.nv)
        noise[:3] = 0.0
        shaken = pin.integrate(model, q, noise)
        shaken[7:] = np.clip(shaken[7:], model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
        return np.asarray(shaken)

    def _next_to(self, name: str, contacts: Mapping[str, Placement]) -> Placement | None:
        """Placement of a sole in the air beside the other one, as in the reference posture, raised by ``LIFT_M``."""
        other = next((one for one in self._soles if one in contacts), None)
        if other is None or (other, name) not in self._apart:
            return None
        return contacts[other] @ Placement(self._apart[other, name] + [0.0, 0.0, LIFT_M], np.eye(3))

    def _unreachable_result(self, stance: Stance, posture: IkResult) -> StanceResult:
        least_m = FAULT_SHARE * max(posture.position_errors_m.values())
        at_fault = [
            name for name, away_m in posture.position_errors_m.items() if away_m >= least_m and name != CENTRE_OF_MASS
        ]
        contact = max(at_fault, key=lambda name: posture.position_errors_m[name], default=None)
        limbs = {joint for name in at_fault for joint in self._limb_joints(name)}
        joints = tuple(joint for joint in posture.at_limit if joint in limbs)[:3]
        ends = f", with the {' and the '.join(map(part_words, joints))} at the end of the range" if joints else ""
        if contact is None:
            far = self._farthest_contact(stance, posture)
            away = f"{100.0 * posture.position_errors_m[CENTRE_OF_MASS]:.1f} cm from where the contacts let it be"
            reason = f"{UNREACHABLE}: the centre of mass stays {away}, the {far.replace('_', ' ')} farthest from it"
            return StanceResult(False, posture.q, False, reason, (far, CENTRE_OF_MASS), far)
        away_m = posture.position_errors_m[contact]
        miss = f"{100.0 * away_m:.1f} cm from" if away_m >= MIN_REPORTED_ERROR_M else "turned from"
        reason = f"{UNREACHABLE}: the {contact.replace('_', ' ')} stays {miss} its place{ends}"
        return StanceResult(False, posture.q, False, reason, (contact, *joints), contact)

    def _farthest_contact(self, stance: Stance, posture: IkResult) -> str:
        """The contact that is farthest from the CoM."""
        com_m = pin.centerOfMass(self.robot.model, self.robot.model.createData(), posture.q)
        return max(stance.contacts, key=lambda name: float(np.linalg.norm(stance.contacts[name].position_m - com_m)))

    def _collision_result(self, posture: IkResult, numbers: tuple[int, ...]) -> StanceResult:
        first, second = self._collision.colliding_links(posture.q)[0]
        reason = f"{UNREACHABLE} without touching itself: the {part_words(first)} is inside the {part_words(second)}"
        return StanceResult(False, posture.q, False, reason, (first, second))

    def _limb_joints(self, name: str) -> set[str]:
        """Joints that move an effector."""
        model = self.robot.model
        joint = model.frames[model.getFrameId(self.robot.effectors[name].frame)].parentJoint
        return {str(model.names[j]) for j in model.supports[joint]}


def _advance_search(search: Generator[None, None, StanceResult], is_over: Callable[[], bool]) -> StanceResult | None:
    """Advance a search to its end, or until ``is_over``."""
    while True:
        try:
            next(search)
        except StopIteration as end:
            result: StanceResult = end.value
            return result
        if is_over():
            return None


def mid_swing_placement(before: Placement | None, after: Placement | None) -> Placement | None:
    """Placement at mid-swing between two contacts, or above the only one given."""
    places = [place for place in (before, after) if place is not None]
    if not places:
        return None
    p = np.mean([place.position_m for place in places], axis=0)
    p[2] = max(place.position_m[2] for place in places) + LIFT_M
    return Placement(p, places[-1].rotation)


def _ik_error(posture: IkResult) -> float:
    return max(posture.error_m, posture.error_rad)


def _sole_offsets(robot: Robot, soles: tuple[str, ...]) -> Mapping[tuple[str, str], Vector3]:
    """Position of each sole in the frame of each other one, in the reference posture."""
    model = robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    placements = {}
    for name in soles:
        effector = robot.effectors[name]
        placement = data.oMf[model.getFrameId(effector.frame)]
        placements[name] = Placement(placement.translation, placement.rotation) @ effector.T_frame_contact
    return {(a, b): (placements[a].inverse() @ placements[b]).position_m for a in soles for b in soles if a != b}


def _rounded_bytes(place: Placement) -> bytes:
    return np.round(np.r_[place.position_m, place.rotation.ravel()], 4).tobytes()
