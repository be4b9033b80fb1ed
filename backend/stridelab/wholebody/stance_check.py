"""Whether the whole body can take the stance of a contact phase: inverse kinematics where densities only estimate.

A stance is reachable where some posture holds every contact of the phase, with the CoM above the support region and
within the learned reach of every contact, every joint inside the range that the whole-body stage plans with, and no
shape of the robot in another one. Feet in the air are held half-way of their swing, or beside the other foot, so that
the legs do not cross. A posture that touches itself is solved for again, with what touches pushed apart.

The search is local. It starts at the reference posture over the contacts and then at a fixed list of others, so the
verdict is a function of the stance alone: it depends neither on what was asked before nor on a neighbouring phase, and
a stance is computed once. "Unreachable" means that none of the starts led to a posture, which is no proof.

A stance says nothing about the motion between two stances: speeds, torques and swings are judged by the plan alone.
"""

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.inverse_kinematics import ComRoom, IkResult, reference_at, stand_in_room
from stridelab.robots.robot import Robot
from stridelab.robots.self_collision import Apart, SelfCollision
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.task_stack import Settings

STARTS: Final = 4
"""Postures besides the reference posture from which a stance is searched for."""
PUSHES: Final = 3
"""How often a posture that touches itself is solved for again, with what touches pushed apart."""
SOLVES: Final = 12
"""Searches after which no other start is tried."""
LOWER_M: Final = (0.08, 0.16)
"""By how much lower the CoM is wanted in further searches."""
FAR_M: Final = 0.05
"""A stance that the first searches miss by more is given up."""
SPREAD_RAD: Final = 0.25
LIFT_M: Final = 0.06
"""Height of a swinging foot over the higher of its two places."""
REMEMBERED: Final = 4096
BLAME: Final = 0.3
"""A contact that is off by less than this share of the worst error is not at fault."""
LEAST_SAID_M: Final = 5e-4
"""A contact that misses its place by less misses its direction."""
CANNOT: Final = "the body cannot take this stance"
CENTRE_OF_MASS: Final = "centre of mass"


@dataclass(frozen=True, eq=False)
class Stance:
    """The contacts of one phase by effector (``T_world_contact``), and where feet in the air are.

    ``region_m`` ``(k, 2)`` is the support region, counter-clockwise, without rows where the CoM may be anywhere;
    ``com_m`` is where the CoM is wanted within it.
    """

    contacts: Mapping[str, Placement]
    com_m: Vector3
    region_m: Float[np.ndarray, "k 2"] = field(default_factory=lambda: np.zeros((0, 2)))
    air: Mapping[str, Placement] = field(default_factory=dict)

    def key(self) -> tuple[object, ...]:
        """Equal for stances that are equal to a tenth of a millimetre."""
        return (
            *((name, _digits(p)) for name, p in sorted(self.contacts.items())),
            "air",
            *((name, _digits(p)) for name, p in sorted(self.air.items())),
            np.round(self.com_m, 4).tobytes(),
            np.round(self.region_m, 4).tobytes(),
        )


@dataclass(frozen=True, eq=False)
class StanceVerdict:
    """Whether the body can take a stance; ``q`` ``(nq,)`` is the posture, or the one that misses it least.

    ``reason`` says in a sentence what ran out, ``limits`` names it: effectors, joints or links. Both are empty where
    the stance is reachable. It is ``strained`` where limbs had to be pushed apart or the search had to start elsewhere:
    the whole-body stage, which does neither, seldom gets through such a stance. ``contact`` is the contact that is
    missed by most, None where that is not the cause.
    """

    reachable: bool
    q: Float[np.ndarray, "nq"]
    strained: bool = False
    reason: str = ""
    limits: tuple[str, ...] = ()
    contact: str | None = None


class _Attempt(NamedTuple):
    """One search: what is placed, where the CoM is wanted, the start (None is the reference posture).

    ``second`` is one that is left out after a far miss.
    """

    placements: Mapping[str, Placement]
    com_m: Vector3
    q_start: Float[np.ndarray, "nq"] | None = None
    second: bool = False


class StanceCheck:
    """The check of one robot, which remembers its verdicts. One per thread: the collision check has buffers."""

    def __init__(self, robot: Robot) -> None:
        settings = Settings()
        self.robot = robot
        self._margins_rad = JointLimits.of(robot.model).margins_rad(settings.range_share, settings.joint_margin_rad)
        self._collision = SelfCollision.of(robot)
        self._known: OrderedDict[tuple[object, ...], StanceVerdict] = OrderedDict()
        self._soles = tuple(name for name, one in robot.effectors.items() if one.kind == "surface")
        self._shapes = effector_shapes(robot.name)
        data = robot.model.createData()
        self._height_m = float(pin.centerOfMass(robot.model, data, robot.q_reference)[2])
        self._apart = _beside(robot, self._soles)

    def usual_com_m(self, contacts: Mapping[str, Placement]) -> Vector3:
        """Over the middle of the soles, as high as in the reference posture."""
        soles = [place.position_m for name, place in contacts.items() if name in self._soles]
        x, y, z = np.mean(soles, axis=0)
        return np.array([x, y, z + self._height_m])

    def verdict(self, stance: Stance) -> StanceVerdict:
        """The verdict on ``stance``. Raises ``InvalidInput`` (``effector-unknown``)."""
        key = stance.key()
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = self._searched(stance)
            if len(self._known) > REMEMBERED:
                self._known.popitem(last=False)
        self._known.move_to_end(key)
        return found

    def _searched(self, stance: Stance) -> StanceVerdict:
        room = self._room(stance)
        missed: IkResult | None = None
        touching: tuple[IkResult, tuple[int, ...]] | None = None
        solves = 0
        for attempt in self._attempts(stance):
            far = touching is None and missed is not None and _off(missed) > FAR_M
            if attempt.second and (far or solves >= SOLVES):
                break
            placements, q_start = attempt.placements, attempt.q_start
            watched: tuple[int, ...] = ()
            for _ in range(1 + PUSHES):
                apart = Apart(self.robot, self._collision.hulls, watched) if watched else None
                found = stand_in_room(self.robot, placements, room, attempt.com_m, q_start, self._margins_rad, apart)
                solves += 1
                if not found.converged:
                    break
                pairs = self._collision.colliding(found.q)
                if not pairs:
                    return StanceVerdict(True, found.q, attempt.second or bool(watched))
                if touching is None or len(pairs) < len(touching[1]):
                    touching = (found, pairs)
                q_start, watched = found.q, tuple(sorted({*watched, *pairs}))
            if (
                not watched
                and len(placements) == len(stance.contacts)
                and (missed is None or _off(found) < _off(missed))
            ):
                missed = found
        if touching is not None:
            return self._collides(*touching)
        if missed is None:
            raise RuntimeError("the search never placed the contacts alone")
        return self._missed(stance, missed)

    def _room(self, stance: Stance) -> ComRoom:
        """Above the support region, and within the learned reach of every contact, as the judge has it."""
        room = ComRoom.above(stance.region_m)
        A, b = [room.A], [room.b]
        for name, place in stance.contacts.items():
            shape = self._shapes.get(name)
            if shape is None or shape.reach is None:
                continue
            axes, here = place.rotation.T, place.rotation.T @ place.position_m
            A += [axes, -axes]
            b += [np.array(shape.reach.com_high_m) + here, -np.array(shape.reach.com_low_m) - here]
        return ComRoom(np.vstack(A), np.concatenate(b))

    def _attempts(self, stance: Stance) -> Iterator[_Attempt]:
        contacts, com_m = stance.contacts, stance.com_m
        beside = {name: p for name in self._soles if name not in contacts and (p := self._next_to(name, contacts))}
        for free in (stance.air, beside):
            if free:
                yield _Attempt({**contacts, **free}, com_m)
        yield _Attempt(contacts, com_m)
        held = {**contacts, **beside}
        for lower_m in LOWER_M:
            yield _Attempt(held, com_m - [0.0, 0.0, lower_m], second=True)
        rng = np.random.default_rng(0)
        reference = reference_at(self.robot, contacts, com_m)
        for _ in range(STARTS):
            yield _Attempt(held, com_m, self._shaken(reference, rng), second=True)

    def _shaken(self, q: Float[np.ndarray, "nq"], rng: np.random.Generator) -> Float[np.ndarray, "nq"]:
        """With normal noise on all angles, within their ranges."""
        model = self.robot.model
        noise = SPREAD_RAD * rng.standard_normal(model.nv)
        noise[:3] = 0.0
        shaken = pin.integrate(model, q, noise)
        shaken[7:] = np.clip(shaken[7:], model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
        return np.asarray(shaken)

    def _next_to(self, name: str, contacts: Mapping[str, Placement]) -> Placement | None:
        """A place for a sole in the air as far from the other one as in the reference posture, and above it."""
        other = next((one for one in self._soles if one in contacts), None)
        if other is None or (other, name) not in self._apart:
            return None
        return contacts[other] @ Placement(self._apart[other, name] + [0.0, 0.0, LIFT_M], np.eye(3))

    def _missed(self, stance: Stance, found: IkResult) -> StanceVerdict:
        least_m = BLAME * max(found.away_m.values())
        at_fault = [name for name, away_m in found.away_m.items() if away_m >= least_m and name != CENTRE_OF_MASS]
        contact = max(at_fault, key=lambda name: found.away_m[name], default=None)
        limbs = {joint for name in at_fault for joint in self._limb(name)}
        joints = tuple(joint for joint in found.at_limit if joint in limbs)[:3]
        ends = f", with {' and '.join(joints)} at the end of the range" if joints else ""
        if contact is None:
            far = self._farthest(stance, found)
            away = f"{100.0 * found.away_m[CENTRE_OF_MASS]:.1f} cm from where the contacts let it be"
            reason = f"{CANNOT}: the centre of mass stays {away}, the {far.replace('_', ' ')} farthest from it"
            return StanceVerdict(False, found.q, False, reason, (far, CENTRE_OF_MASS), far)
        away_m = found.away_m[contact]
        missed = f"{100.0 * away_m:.1f} cm from" if away_m >= LEAST_SAID_M else "turned from"
        reason = f"{CANNOT}: the {contact.replace('_', ' ')} stays {missed} its place{ends}"
        return StanceVerdict(False, found.q, False, reason, (contact, *joints), contact)

    def _farthest(self, stance: Stance, found: IkResult) -> str:
        """The contact that is farthest from the CoM."""
        com_m = pin.centerOfMass(self.robot.model, self.robot.model.createData(), found.q)
        return max(stance.contacts, key=lambda name: float(np.linalg.norm(stance.contacts[name].position_m - com_m)))

    def _collides(self, found: IkResult, numbers: tuple[int, ...]) -> StanceVerdict:
        first, second = self._collision.pairs(found.q)[0]
        reason = f"{CANNOT} without touching itself: {first} is inside {second}"
        return StanceVerdict(False, found.q, False, reason, (first, second))

    def _limb(self, name: str) -> set[str]:
        """Joints that move an effector."""
        model = self.robot.model
        joint = model.frames[model.getFrameId(self.robot.effectors[name].frame)].parentJoint
        return {str(model.names[j]) for j in model.supports[joint]}


def swung(before: Placement | None, after: Placement | None) -> Placement | None:
    """Half-way of a swing between two places; over the only one where the other is missing."""
    places = [place for place in (before, after) if place is not None]
    if not places:
        return None
    p = np.mean([place.position_m for place in places], axis=0)
    p[2] = max(place.position_m[2] for place in places) + LIFT_M
    return Placement(p, places[-1].rotation)


def _off(found: IkResult) -> float:
    return max(found.error_m, found.error_rad)


def _beside(robot: Robot, soles: tuple[str, ...]) -> Mapping[tuple[str, str], Vector3]:
    """Where each sole is in the frame of each other one, in the reference posture."""
    model = robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    at = {}
    for name in soles:
        effector = robot.effectors[name]
        here = data.oMf[model.getFrameId(effector.frame)]
        at[name] = Placement(here.translation, here.rotation) @ effector.T_frame_contact
    return {(a, b): (at[a].inverse() @ at[b]).position_m for a in soles for b in soles if a != b}


def _digits(place: Placement) -> bytes:
    return np.round(np.r_[place.position_m, place.rotation.ravel()], 4).tobytes()
