"""Recovery from a push by steps: the robot leaves the plan and steps until it stands at rest.

At every sample the whole body is solved for the measured state (``balance_rows``). The place and the time of the
swinging sole follow from the measured capture point (``step_choice``) until shortly before it lands. Meanwhile the
centre of pressure brakes: it is as far towards the capture point as the standing sole allows. On two soles the
pressure goes beyond the capture point, which brings it back between them; a step begins as soon as it leaves the hull
of the soles.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Angles
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_avoidance import AvoidanceSettings, CollisionAvoidance
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.recovery.balance_rows import (
    BalanceRows,
    BalanceTargets,
    BalanceWeights,
    LevelHeading,
    recovery_settings,
)
from stridelab.wholebody.recovery.driven_joints import DrivenJoints
from stridelab.wholebody.recovery.footholds import Footholds
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.recovery.step_choice import (
    CORNERS,
    Shift,
    Step,
    StepChooser,
    StepSearch,
    Swinging,
    braking_pressure,
    nearest_in_hull,
)
from stridelab.wholebody.recovery.swing_aim import AimedSwing
from stridelab.wholebody.replay.dcm_feedback import pendulum_rate
from stridelab.wholebody.replay.sensors import SensedState

_OUTSIDE_M = 1e-6
"""Distance from a hull above which a point is outside of it."""

_LEVEL_M = 0.02
"""Difference of the soles' heights below which they stand on one level."""

_DOWN_M = 3e-3
"""Distance of an unloaded sole from the ground below which it stands."""


@dataclass(frozen=True)
class Recovery:
    """Settings.

    The recovery begins when the capture point's error exceeds what the soles can correct by ``takeover_m``. A sole
    has landed under ``loaded_share`` of the weight. Steps are chosen every ``choose_every`` samples until
    ``fixed_s`` before the landing; a sole passes ``clearance_m`` over the ground. ``gain`` moves the centre of
    pressure of two soles beyond the capture point, ``margin_m``, or ``margin_share`` of half a sole, inside their
    edges. ``straight`` is the largest length of a leg as a share of the straight one. A sole whose leg does not let
    the CoM be above the capture point at the share ``least_height`` of its usual height steps. The CoM stays at
    ``crouch`` of its usual height; it rises by at most ``rise_m_s`` on one level and ``climb_m_s`` otherwise, and
    its vertical reference accelerates by at most ``height_m_s2``. The robot is at rest below ``still_m_s`` for
    ``rest_s``; a recovery that lasts longer than ``most_s`` has failed. The joints' damping around the solution is
    ``damping`` of the replay's. A robot has fallen below ``low`` of its CoM height above its lowest sole, or with a
    base tilted by more than ``tilt_rad``.
    """

    takeover_m: float = 0.0
    loaded_share: float = 0.1
    choose_every: int = 4
    fixed_s: float = 0.06
    clearance_m: float = 0.05
    gain: float = 1.0
    margin_m: float = 0.012
    margin_share: float = 0.2
    straight: float = 0.97
    least_height: float = 0.88
    crouch: float = 0.97
    rise_m_s: float = 0.15
    climb_m_s: float = 0.5
    height_m_s2: float = 3.0
    still_m_s: float = 0.05
    rest_s: float = 1.0
    most_s: float = 15.0
    damping: float = 0.2
    low: float = 0.6
    tilt_rad: float = 1.0
    search: StepSearch = field(default_factory=StepSearch)
    weights: BalanceWeights = field(default_factory=BalanceWeights)
    avoid: AvoidanceSettings | None = field(default_factory=AvoidanceSettings)


class JointCommand(NamedTuple):
    """Torques, and velocities and accelerations around which the joints are damped until the next sample."""

    tau_nm: Angles
    v_rad_s: Angles
    a_rad_s2: Angles


class RecoveryRun:
    """State of one recovery, which begins on the soles of ``planned`` at ``measured``.

    ``steps`` counts landings, ``steps_before`` those of a walk before it was lost; ``left_plan_s`` is the time of the
    beginning, or of that loss.
    """

    def __init__(
        self,
        settings: Recovery,
        robot: Robot,
        legs: LegGeometry,
        sequence: ContactSequence,
        planned: Mapping[str, Contact],
        measured: SensedState,
        dt_s: float,
    ) -> None:
        self._by, self._robot, self._legs, self._dt_s = settings, robot, legs, dt_s
        self._friction = sequence.friction
        self._inner_m = legs.half_m - np.minimum(settings.margin_m, settings.margin_share * legs.half_m)
        self._body = RigidBody(robot)
        self._limits = recovery_settings()
        avoid = settings.avoid
        self._avoidance = None if avoid is None else CollisionAvoidance(robot, sequence.terrain, avoid)
        self._footholds = Footholds(sequence.terrain)
        self._chooser = StepChooser(settings.search, legs, self._footholds)
        self._loaded_n = settings.loaded_share * GRAVITY_M_S2 * robot.mass_kg
        self.left_plan_s, self.steps, self.steps_before, self._still_s = measured.time_s, 0, 0, 0.0
        self._time_s = measured.time_s
        self._contacts: dict[str, Contact] = {}
        self._driven: DrivenJoints | None = None
        self._swing: AimedSwing | None = None
        self._step: Step | None = None
        self._body.update(measured.q, measured.v)
        loads_n = {name: float(np.linalg.norm(measured.forces_n[name])) for name in legs.side}
        standing = {name for name in legs.side if name in planned} or {max(loads_n, key=loads_n.__getitem__)}
        standing = {name for name in legs.side if self._is_down(name, measured, loads_n[name])} or standing
        for name in standing:
            self._put_down(name, measured)
        ahead = sum((c.placement.rotation[:2, 0] for c in self._contacts.values()), start=np.zeros(2))
        ahead = ahead + self._body.frame_state("base").rotation[:2, 0]
        self._base = self._sole = LevelHeading(float(np.arctan2(ahead[1], ahead[0])))
        self._axes = self._base.axes
        self._height_m = float(self._body.com_m[2])
        self._height_rate_m_s = float(np.clip(self._body.com_v_m_s[2], -0.3, 0.3))
        for name in legs.side:
            if name not in self._contacts:
                self._lift_off(name, measured)
        self._state_rows()

    def leave_joints(self, driven: DrivenJoints | None) -> None:
        """Leave joints to their own servo from now on."""
        self._driven = driven
        self._state_rows()

    @property
    def at_rest(self) -> bool:
        """Whether the robot has stood still on two soles for long enough."""
        return self._still_s > self._by.rest_s

    @property
    def has_fallen(self) -> bool:
        """Whether the last measured posture is low or tilted, or the recovery does not end."""
        low_m = min(contact.placement.position_m[2] for contact in self._contacts.values())
        upright = float(self._body.frame_state("base").rotation[2, 2])
        return bool(
            self._body.com_m[2] - low_m < self._by.low * self._legs.com_height_m
            or upright < np.cos(self._by.tilt_rad)
            or self._time_s - self.left_plan_s > self._by.most_s
        )

    @property
    def next_foothold_m(self) -> Float[np.ndarray, "3"] | None:
        """Where the swinging sole is to land; None while both soles stand."""
        return None if self._step is None else np.array([*self._step.place_m, self._step.height_m])

    def compute_command(self, measured: SensedState) -> JointCommand:
        """Joint command for the measured state."""
        body, self._time_s = self._body, measured.time_s
        body.update(measured.q, measured.v)
        ground_m = min(float(contact.placement.position_m[2]) for contact in self._contacts.values())
        w = pendulum_rate(float(body.com_m[2]) - ground_m)
        capture_m = body.com_m[:2] + body.com_v_m_s[:2] / w
        if self._swing is not None:
            self._check_landing(self._swing, measured)
        if self._swing is None:
            pressure_m = self._stand(capture_m, w, measured)
        if self._swing is not None:
            pressure_m = self._aim_swing(self._swing, capture_m, w)
        self._update_height(pressure_m, w)
        swings = {} if self._swing is None else {self._in_air: self._swing}
        acceleration = w * w * (body.com_m[:2] - pressure_m)
        targets = BalanceTargets(acceleration, self._height_m, self._height_rate_m_s, self._base, self._sole, swings)
        found = self._rows.solve_sample(targets)
        still = self._swing is None and float(np.linalg.norm(body.com_v_m_s[:2])) < self._by.still_m_s
        self._still_s = self._still_s + self._dt_s if still else 0.0
        return JointCommand(found.tau_nm, measured.v[6:].copy(), found.a[6:])

    @property
    def _in_air(self) -> str:
        return next(name for name in self._legs.side if name not in self._contacts)

    def _is_down(self, name: str, measured: SensedState, load_n: float) -> bool:
        """Whether a sole is loaded, or near enough to the ground below it to be loaded at once."""
        at_m = measured.contacts[name].position_m
        ground_m = float(self._footholds.ground_heights_m(at_m[:2]))
        return load_n > self._loaded_n or abs(float(at_m[2]) - ground_m) < _DOWN_M

    def _put_down(self, name: str, measured: SensedState) -> None:
        half = self._robot.effectors[name].contact_half_size_m
        self._contacts[name] = Contact(name, measured.contacts[name], "", self._friction, "surface", half)

    def _lift_off(self, name: str, measured: SensedState) -> None:
        self._contacts.pop(name, None)
        frame = self._body.frame_state(name)
        self._swing, self._step, self._samples = AimedSwing(frame.position_m, frame.velocity[:3]), None, 0
        self._lifted_s = self._time_s
        self._unloaded = float(np.linalg.norm(measured.forces_n[name])) < self._loaded_n

    def _state_rows(self) -> None:
        self._rows = BalanceRows(
            self._robot, self._body, self._contacts, self._by.weights, self._limits, self._avoidance, self._driven
        )

    def _check_landing(self, swing: AimedSwing, measured: SensedState) -> None:
        name = self._in_air
        loaded = float(np.linalg.norm(measured.forces_n[name])) > self._loaded_n
        self._unloaded = self._unloaded or not loaded
        near = swing.landing or (self._step is not None and self._step.in_s < 0.1)
        if loaded and self._unloaded and (near or self._time_s - self._lifted_s > 0.2):
            self._put_down(name, measured)
            self._swing, self._step, self.steps = None, None, self.steps + 1
            self._state_rows()

    def _stand(self, capture_m: Shift, w: float, measured: SensedState) -> Shift:
        """Centre of pressure on two soles; lifts one if the capture point is outside of their hull."""
        places = {name: contact.placement.position_m for name, contact in self._contacts.items()}
        origin, other = places.values()
        xi, end = self._axes.T @ (capture_m - origin[:2]), self._axes.T @ (other - origin)[:2]
        half = self._inner_m
        _, excess = nearest_in_hull(xi, end, self._legs.half_m)
        low_m = self._by.least_height * self._legs.com_height_m
        short = {name for name, at in places.items() if self._highest_m(name, at, capture_m) - float(at[2]) < low_m}
        if float(excess) > _OUTSIDE_M or short:
            steps = {}
            for name in short or places:
                (stance_m,) = (at for sole, at in places.items() if sole != name)
                top_m = float(places[name][2]) + self._by.clearance_m
                swing = Swinging(places[name], np.zeros(3), self._legs.side[name], 0.0, top_m)
                steps[name] = self._chooser.choose_step(capture_m, w, stance_m, swing, self._axes, None)
            found = {name: step for name, step in steps.items() if step is not None}
            if found:
                name = min(found, key=lambda sole: found[sole].cost)
                self._lift_off(name, measured)
                self._take_step(found[name])
                self._state_rows()
        pressure, _ = nearest_in_hull(xi + self._by.gain * (xi - 0.5 * end), end, half)
        return np.asarray(origin[:2] + self._axes @ pressure)

    def _take_step(self, step: Step) -> None:
        self._step = step
        if self._swing is not None:
            corners = CORNERS * (self._legs.half_m + 0.01) @ self._axes.T
            top_m = self._footholds.highest_m(self._swing.position_m[:2], step.place_m, corners)
            self._swing.clear_m = max(top_m, step.height_m) + self._by.clearance_m

    def _aim_swing(self, swing: AimedSwing, capture_m: Shift, w: float) -> Shift:
        """Choose the step anew, advance the swing, and return the centre of pressure on the standing sole."""
        name, (stance,) = self._in_air, self._contacts.values()
        at, aloft_s = stance.placement.position_m, self._time_s - self._lifted_s
        if self._step is not None:
            self._step = replace(self._step, in_s=self._step.in_s - self._dt_s)
        if self._samples % self._by.choose_every == 0 and (self._step is None or self._step.in_s > self._by.fixed_s):
            clear = swing.position_m[2] > at[2] + 0.02 and (self.steps == 0 or aloft_s > 0.08)
            corners = CORNERS * self._legs.half_m @ self._axes.T
            top_m = (
                self._footholds.highest_m(swing.position_m[:2], swing.position_m[:2], corners) + self._by.clearance_m
            )
            aloft = None if clear else aloft_s
            side = self._legs.side[name]
            was_up = self._lifted_s <= self.left_plan_s
            state = Swinging(swing.position_m, swing.velocity_m_s, side, aloft, top_m, swing.landing, was_up)
            step = self._chooser.choose_step(capture_m, w, at, state, self._axes, self._step)
            if step is not None:
                self._take_step(step)
        self._samples += 1
        if self._step is None:
            return np.asarray(at[:2])
        frame = self._body.frame_state(name)
        swing.follow(frame.position_m, frame.velocity[:3])
        growth = float(np.exp(w * max(self._step.in_s, 0.02)))
        xi = self._axes.T @ (capture_m - at[:2])
        pressure = braking_pressure(xi, growth, self._inner_m)
        swing.advance(self._step.place_m, self._step.height_m, self._step.in_s, self._dt_s)
        return np.asarray(at[:2] + self._axes @ pressure)

    def _update_height(self, pressure_m: Shift, w: float) -> None:
        """Height of the CoM: the usual one above the soles, less where a leg would be too short.

        The leg in the air need not reach before the landing, when the CoM has moved on.
        """
        legs, com_m = self._legs, self._body.com_m
        feet: dict[str, Float[np.ndarray, "3"]] = {n: c.placement.position_m for n, c in self._contacts.items()}
        highest_m = [self._highest_m(name, foot, com_m[:2]) for name, foot in feet.items()]
        if self._step is not None:
            feet[self._in_air] = np.array([*self._step.place_m, self._step.height_m])
            x = w * max(self._step.in_s, 0.0)
            landing_m = pressure_m + np.cosh(x) * (com_m[:2] - pressure_m) + np.sinh(x) / w * self._body.com_v_m_s[:2]
            highest_m.append(self._highest_m(self._in_air, feet[self._in_air], landing_m))
        heights = [float(foot[2]) for foot in feet.values()]
        wished_m = min(float(np.mean(heights)) + self._by.crouch * legs.com_height_m, *highest_m)
        fastest_m_s = self._by.rise_m_s if max(heights) - min(heights) < _LEVEL_M else self._by.climb_m_s
        rate = float(np.clip((wished_m - self._height_m) / 0.12, -0.7, fastest_m_s))
        most_m_s = self._by.height_m_s2 * self._dt_s
        change = float(np.clip(rate - self._height_rate_m_s, -most_m_s, most_m_s))
        self._height_rate_m_s += change
        self._height_m += self._height_rate_m_s * self._dt_s

    def _highest_m(self, name: str, foot_m: Float[np.ndarray, "3"], com_m: Shift) -> float:
        """Largest height of a CoM above ``com_m`` whose leg reaches the sole at ``foot_m``, with the trunk upright."""
        hip, longest_m = self._legs.hip_m[name], self._by.straight * self._legs.leg_m
        away_m = float(np.linalg.norm(com_m + self._axes @ hip[:2] - foot_m[:2]))
        up_m = float(np.sqrt(max(longest_m**2 - away_m**2, (0.6 * longest_m) ** 2)))
        return float(foot_m[2]) + self._legs.ankle_m + up_m - float(hip[2])
