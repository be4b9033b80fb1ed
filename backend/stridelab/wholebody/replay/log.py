"""Measurements during the replay of a motion.

Conditions of a completed replay: the robot does not fall and follows the plan within limits.

Each violated condition is reported with its value, so that its severity is visible.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.contacts.swing import HAND_RETREAT_M
from stridelab.conventions import Series, Vector3
from stridelab.dynamics.spatial import length_of
from stridelab.robots.part_names import part_words
from stridelab.robots.robot import Robot
from stridelab.wholebody.effector_contact import OwnSurfaces
from stridelab.wholebody.replay.simulation import Simulation

SLIP_M: Final = 0.020
"""Largest displacement of a loaded sole."""
TORQUE_RATIO: Final = 1.2
"""Largest commanded torque as a multiple of its limit, at which the applied torque is clipped."""
ARRIVAL_M: Final = 0.05
"""Largest distance of an effector from its place at the end of a plan that was left and resumed."""
HAND_SHARE: Final = 0.95
"""Share of its planned contact time in which a hand has to be loaded at its planned position."""
_LISTED: Final = 4


@dataclass(frozen=True)
class Collision:
    """An unplanned contact of two links, or of a link or an effector with a surface.

    ``time_s`` is its first occurrence, ``force_max_n`` the largest force.
    """

    first: str
    second: str
    time_s: float
    force_max_n: float


@dataclass(frozen=True)
class TorquePeak:
    """The largest commanded torque, as a multiple ``ratio`` of its limit, with its joint and time."""

    ratio: float = 0.0
    joint: str = ""
    time_s: float = 0.0


@dataclass(frozen=True)
class MissedCondition:
    """One violated condition: a stable code and a sentence with the value."""

    code: str
    message: str


@dataclass(frozen=True)
class LeftPlan:
    """The plan was left at ``time_s`` for a recovery of ``steps`` steps; ``rested`` if the last one ended at rest.

    ``resumed_s`` is the time of the last resumption, ``not_resumed`` the reason why there was none after the last
    recovery, ``missed_m`` the largest distance of an effector from its place at the end of the plan.
    """

    time_s: float
    steps: int
    rested: bool
    resumed_s: float | None = None
    not_resumed: str = ""
    missed_m: float = np.inf

    @property
    def arrived(self) -> bool:
        """Whether the robot ends on the contacts with which the plan ends."""
        return self.missed_m < ARRIVAL_M

    @property
    def description(self) -> str:
        """What became of the plan, as a sentence."""
        steps = "1 step" if self.steps == 1 else f"{self.steps} steps"
        text = f"The robot leaves the plan at {self.time_s:.1f} s, and after {steps} it "
        if not self.rested:
            return text + "does not come to rest."
        if self.not_resumed:
            return f"{text}stands at rest; the plan is not resumed: {self.not_resumed}."
        if self.resumed_s is None:
            return text + "stands at rest."
        ending = "is not reached" if np.isinf(self.missed_m) else f"is missed by {1e3 * self.missed_m:.0f} mm"
        return f"{text}goes on at {self.resumed_s:.1f} s; the end of the plan {ending}."


def missed_conditions(
    *,
    fall_time_s: float | None,
    left_plan: LeftPlan | None = None,
    collided: Sequence[Collision],
    slip_max_m: float,
    torque_peak: TorquePeak,
    hand_in_place_shares: Mapping[str, float],
) -> tuple[MissedCondition, ...]:
    """Violated conditions of a completed replay, a fall first."""
    violated: list[MissedCondition] = []
    if fall_time_s is not None:
        violated.append(MissedCondition("replay-fell", f"The robot falls after {fall_time_s:.1f} s."))
    if left_plan is not None and not left_plan.arrived:
        violated.append(MissedCondition("replay-left-plan", left_plan.description))
    if collided:
        violated.append(MissedCondition("replay-collided", _describe_collisions(collided)))
    if slip_max_m > SLIP_M:
        message = f"A loaded foot slips by {1e3 * slip_max_m:.0f} mm; at most {1e3 * SLIP_M:.0f} mm are allowed."
        violated.append(MissedCondition("replay-slipped", message))
    if torque_peak.ratio > TORQUE_RATIO:
        reaches = f"reaches {torque_peak.ratio:.1f} times its limit at {torque_peak.time_s:.2f} s"
        message = f"The torque command of the {part_words(torque_peak.joint)} {reaches}; {TORQUE_RATIO:g} is allowed."
        violated.append(MissedCondition("replay-torque", message))
    for hand, share in hand_in_place_shares.items():
        if share < HAND_SHARE:
            message = f"{hand} is in place for {share:.0%} of its contact; {HAND_SHARE:.0%} is required."
            violated.append(MissedCondition("replay-hand-off", message))
    return tuple(violated)


def _describe_collisions(collided: Sequence[Collision]) -> str:
    listed = "; ".join(
        f"{one.first} and {one.second} from {one.time_s:.2f} s, {one.force_max_n:.0f} N at most"
        for one in collided[:_LISTED]
    )
    more = f"; and {len(collided) - _LISTED} more" if len(collided) > _LISTED else ""
    pairs = "1 pair touches" if len(collided) == 1 else f"{len(collided)} pairs touch"
    return f"{pairs} without being planned to: {listed}{more}."


LOADED_N: Final = 5.0
"""Force from which an effector counts as loaded."""


@dataclass(frozen=True, eq=False)
class Replay:
    """Result of a replay. ``q``, ``v`` are in the order of the motion; ``forces_n`` the world-frame force per effector.

    ``plan_time_s`` is the time of the plan, whose clock the stabiliser may change. Errors are those of the simulated
    CoM against the plan's. ``foot_slip_max_m`` is the largest displacement of a
    loaded sole since its touch-down, ``landing_error_max_m`` the largest distance from the planned position there.
    ``hand_contact_share`` is the share of the planned hand contacts in which the hand is loaded;
    ``hand_in_place_shares`` is, per hand, the share in which it is loaded by the planned surface within the retreat
    distance of a releasing hand from its planned position. ``collided`` are the unplanned contacts in the order of
    time. ``fall_time_s`` is None if the robot does not fall. ``left_plan`` describes the recoveries that left the plan,
    if any: their soles may land on any surface, and hands and landing positions are not judged during them. After a
    resumption, errors are those against the new motion.
    """

    time_s: Float[np.ndarray, "n"]
    plan_time_s: Float[np.ndarray, "n"]
    q: Float[np.ndarray, "n nq"]
    v: Float[np.ndarray, "n nv"]
    com_m: Float[np.ndarray, "n 3"]
    forces_n: Mapping[str, Float[np.ndarray, "n 3"]]
    fall_time_s: float | None
    com_error_rms_m: float
    com_error_max_m: float
    foot_slip_max_m: float
    landing_error_max_m: float
    hand_force_mean_n: float | None
    hand_contact_share: float | None
    torque_peak: TorquePeak
    real_time_factor: float
    hand_in_place_shares: Mapping[str, float] = field(default_factory=dict)
    collided: tuple[Collision, ...] = ()
    left_plan: LeftPlan | None = None

    @property
    def fell(self) -> bool:
        """Whether the robot fell; the replay ends there."""
        return self.fall_time_s is not None

    @property
    def arrived(self) -> bool:
        """Whether the robot ends on the contacts with which the plan ends, also after recoveries."""
        return not self.fell and (self.left_plan is None or self.left_plan.arrived)

    @property
    def torque_ratio_max(self) -> float:
        """The largest commanded torque as a multiple of its limit."""
        return self.torque_peak.ratio

    @property
    def slip_max_m(self) -> float:
        """The largest displacement of a loaded sole since its touch-down."""
        return self.foot_slip_max_m

    @property
    def collisions(self) -> int:
        """Number of distinct pairs with unplanned contact."""
        return len(self.collided)

    @property
    def remarks(self) -> tuple[MissedCondition, ...]:
        """Violated conditions of a completed replay."""
        return missed_conditions(
            fall_time_s=self.fall_time_s,
            left_plan=self.left_plan,
            collided=self.collided,
            slip_max_m=self.foot_slip_max_m,
            torque_peak=self.torque_peak,
            hand_in_place_shares=self.hand_in_place_shares,
        )

    @property
    def completed(self) -> bool:
        """Whether all conditions are met."""
        return not self.remarks


class ReplayLog:
    """Records samples; a touch-down is the first loaded sample of a planned contact."""

    def __init__(self, robot: Robot, sequence: ContactSequence) -> None:
        self._robot, self._sequence = robot, sequence
        self._time_s: list[float] = []
        self._plan_time_s: list[float] = []
        self._q: list[Float[np.ndarray, "nq"]] = []
        self._v: list[Float[np.ndarray, "nv"]] = []
        self._com_m: list[Vector3] = []
        self._errors_m: list[float] = []
        self._forces_n: dict[str, list[Vector3]] = {name: [] for name in sequence.effectors}
        self._landed: dict[str, Vector3] = {}
        self._slips_m, self._landings_m = [0.0], [0.0]
        self._hand_n: list[float] = []
        self._own = OwnSurfaces(sequence, robot.effectors)
        self._in_place: dict[str, list[bool]] = {}
        self._collided: dict[tuple[str, str], Collision] = {}
        self._clock: tuple[int, float] | None = (0, 0.0)

    def record_step(self, simulation: Simulation, time_s: float) -> None:
        """Record the contacts of the body in the step that ends at ``time_s``."""
        built = simulation.built
        for contact in simulation.body_contacts:
            if contact.sole and self._stands_on(contact.sole, {built.surface.get(geom, "") for geom in contact[:2]}):
                continue
            first, second = (built.link.get(geom) or built.surface.get(geom, "") for geom in contact[:2])
            self._record_collision(first, second, time_s, contact.force_n)

    @property
    def collided(self) -> tuple[Collision, ...]:
        """The unplanned contacts so far, in the order of time."""
        return tuple(self._collided.values())

    def _stands_on(self, sole: str, surfaces: set[str]) -> bool:
        """Whether one of the surfaces is that of the sole's contact, or one that it leaves or approaches."""
        if self._clock is None:
            return True  # soles that recover may land on any surface
        phase, followed_s = self._clock
        own = self._own.contact_surfaces(sole, phase) | self._own.nearby_surfaces(sole, phase, followed_s)
        return not own.isdisjoint(surfaces)

    def samples_from(self, start: int) -> tuple[Series, Float[np.ndarray, "k nq"]]:
        """Times and postures of the samples from ``start`` on; there has to be one."""
        return np.array(self._time_s[start:]), np.array(self._q[start:])

    def record_sample(
        self,
        simulation: Simulation,
        times_s: tuple[float, float, float],
        com_m: Vector3,
        error_m: float,
        plan_left: bool = False,
    ) -> None:
        """Record the state after a step; ``times_s`` are its end, that of the plan and that of the followed motion."""
        time_s, plan_time_s, followed_s = times_s
        q, v = simulation.coordinates()
        self._time_s.append(time_s)
        self._plan_time_s.append(plan_time_s)
        self._q.append(q)
        self._v.append(v)
        self._com_m.append(com_m)
        self._errors_m.append(error_m)
        forces = simulation.forces_n()
        if plan_left:
            self._clock = None
            self._record_recovery(simulation, time_s, forces)
            return
        phase = self._sequence.phase_at(followed_s)
        self._clock = phase, followed_s
        planned = self._sequence.phases[phase].contacts
        in_contact = self._effectors_in_contact(simulation, phase, time_s, followed_s)
        for name, force in forces.items():
            self._forces_n[name].append(force)
            if self._robot.effectors[name].kind == "surface":
                self._record_sole(simulation, name, planned.get(name), length_of(force))
            elif name in planned:
                force_n = length_of(force)
                self._hand_n.append(force_n)
                away_m = simulation.contact_placement(name).position_m - planned[name].placement.position_m
                in_place = name in in_contact and force_n > LOADED_N and length_of(away_m) < HAND_RETREAT_M
                self._in_place.setdefault(name, []).append(in_place)

    def _record_recovery(self, simulation: Simulation, time_s: float, forces_n: Mapping[str, Vector3]) -> None:
        """Slip of the soles since they were loaded, and hands that touch anything."""
        for name, force_n in forces_n.items():
            self._forces_n[name].append(force_n)
            is_loaded = length_of(force_n) > LOADED_N
            if self._robot.effectors[name].kind == "surface":
                position_m = simulation.contact_placement(name).position_m
                if is_loaded:
                    self._slips_m.append(float(np.linalg.norm(position_m - self._landed.setdefault(name, position_m))))
                else:
                    self._landed.pop(name, None)
        for contact in simulation.effector_contacts():
            name, surface = simulation.built.effector[contact.first], simulation.built.surface.get(contact.second)
            if surface is not None and self._robot.effectors[name].kind != "surface":
                self._record_collision(name, surface, time_s, contact.force_n)

    def follow_sequence(self, sequence: ContactSequence) -> None:
        """Judge the contacts of the following samples by another sequence; its soles stand already."""
        self._sequence, self._own = sequence, OwnSurfaces(sequence, self._robot.effectors)

    def _effectors_in_contact(self, simulation: Simulation, phase: int, time_s: float, followed_s: float) -> set[str]:
        """Effectors on surfaces of their planned contacts; records unplanned contacts as collisions."""
        in_contact: set[str] = set()
        built = simulation.built
        for contact in simulation.effector_contacts():
            name, surface = built.effector[contact.first], built.surface.get(contact.second)
            if surface is None:
                continue  # a sole against another link: the link's shape is in ``body_touches``
            if surface in self._own.contact_surfaces(name, phase):
                in_contact.add(name)
            elif surface not in self._own.nearby_surfaces(name, phase, followed_s):
                self._record_collision(name, surface, time_s, contact.force_n)
        return in_contact

    def _record_collision(self, first: str, second: str, time_s: float, force_n: float) -> None:
        pair = (first, second)
        before = self._collided.get(pair)
        if before is None:
            self._collided[pair] = Collision(first, second, time_s, force_n)
        elif force_n > before.force_max_n:
            self._collided[pair] = replace(before, force_max_n=force_n)

    def _record_sole(self, simulation: Simulation, name: str, planned: Contact | None, force_n: float) -> None:
        if planned is None:
            self._landed.pop(name, None)
        elif force_n > LOADED_N:
            position_m = simulation.contact_placement(name).position_m
            if name not in self._landed:
                self._landed[name] = position_m
                self._landings_m.append(float(np.linalg.norm(position_m - planned.placement.position_m)))
            self._slips_m.append(length_of(position_m - self._landed[name]))

    def trim_samples(self, most: int) -> None:
        """Forget all samples but the last ``most``; collisions and the largest slip go back as far as before."""
        for numbers in (self._time_s, self._plan_time_s, self._errors_m, self._hand_n):
            del numbers[:-most]
        for flags in self._in_place.values():
            del flags[:-most]
        for arrays in (self._q, self._v, self._com_m, *self._forces_n.values()):
            del arrays[:-most]
        for largest in (self._slips_m, self._landings_m):
            largest[:] = [max(largest)]

    def to_replay(
        self, fell: bool, torque_peak: TorquePeak, took_s: float, left_plan: LeftPlan | None = None
    ) -> Replay:
        """The result of the recorded samples."""
        errors = np.array(self._errors_m)
        hand = np.array(self._hand_n)
        return Replay(
            time_s=np.array(self._time_s),
            plan_time_s=np.array(self._plan_time_s),
            q=np.array(self._q),
            v=np.array(self._v),
            com_m=np.array(self._com_m),
            forces_n={name: np.array(forces) for name, forces in self._forces_n.items()},
            fall_time_s=self._time_s[-1] if fell else None,
            com_error_rms_m=float(np.sqrt(np.mean(errors**2))),
            com_error_max_m=float(errors.max()),
            foot_slip_max_m=max(self._slips_m),
            landing_error_max_m=max(self._landings_m),
            hand_force_mean_n=float(hand.mean()) if len(hand) else None,
            hand_contact_share=float(np.mean(hand > LOADED_N)) if len(hand) else None,
            torque_peak=torque_peak,
            real_time_factor=self._time_s[-1] / took_s,
            hand_in_place_shares={name: float(np.mean(in_place)) for name, in_place in self._in_place.items()},
            collided=self.collided,
            left_plan=left_plan,
        )
