"""Recovery from a push by steps: the plan is left, and the robot steps until it stands.

At every sample the whole body is solved for the measured state (``balance_rows``); the place and the time of the
swinging sole follow from the measured capture point (``step_choice``) until shortly before it lands. On two soles a
step begins as soon as the capture point leaves their hull. The recovery ends when the robot stands at rest.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Angles
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_avoidance import AvoidanceSettings, CollisionAvoidance
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.recovery.balance_rows import (
    BalanceRows,
    BalanceTargets,
    BalanceWeights,
    SwingTarget,
    recovery_settings,
)
from stridelab.wholebody.recovery.footholds import Footholds
from stridelab.wholebody.recovery.step_choice import Step, StepChooser, StepLimits, segment_excess
from stridelab.wholebody.recovery.swing_aim import AimedSwing
from stridelab.wholebody.replay.sensors import SensedState


import os
TRACE2 = bool(os.environ.get("TRACE2"))
TRACE = bool(os.environ.get("TRACE"))
TRACE_N = int(os.environ.get("TRACE") or 10)


@dataclass(frozen=True)
class Recovery:
    """Settings; lengths that scale with the leg are given for one of ``leg_m``."""

    loaded_share: float = 0.1
    choose_every: int = 4
    frozen_s: float = 0.06
    gain: float = 1.0
    margin_m: float = 0.012
    step_excess_m: float = 0.0
    ahead: float = 0.85
    back: float = 0.75
    aside: float = 0.85
    hip: float = float(os.environ.get('HIP', '0.0'))
    straight: float = 0.97
    weights: BalanceWeights = field(default_factory=BalanceWeights)
    avoid: AvoidanceSettings | None = field(default_factory=AvoidanceSettings)


@dataclass
class Command:
    """Joint command of one sample: torques, and velocity and acceleration of the joints."""

    tau_nm: Angles
    q_rad: Angles
    v_rad_s: Angles
    a_rad_s2: Angles


class RecoveryRun:
    """State of one recovery."""

    def __init__(self, settings: Recovery, robot: Robot, sequence: ContactSequence, dt_s: float) -> None:
        self._by, self._robot, self._sequence, self._dt_s = settings, robot, sequence, dt_s
        self._body = RigidBody(robot)
        self._rows_settings = recovery_settings()
        self._avoidance = (
            None if settings.avoid is None else CollisionAvoidance(robot, sequence.terrain, settings.avoid)
        )
        self._footholds = Footholds(sequence.terrain)
        self._soles = tuple(name for name, e in robot.effectors.items() if e.kind == "surface")
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, robot.q_reference)
        place = {
            name: np.array(
                (data.oMf[robot.model.getFrameId(robot.effectors[name].frame)]).translation
            )
            for name in self._soles
        }
        self._side = {name: float(np.sign(place[name][1])) for name in self._soles}
        com = pin.centerOfMass(robot.model, data, robot.q_reference)
        self._com_height_m = float(com[2])
        self._loaded_n = settings.loaded_share * GRAVITY_M_S2 * robot.mass_kg
        self._hip_m = {}
        for name in self._soles:
            frame = robot.model.frames[robot.model.getFrameId(robot.effectors[name].frame)]
            chain = [j for j in robot.model.supports[frame.parentJoint] if robot.group.get(robot.model.names[j]) == "leg"]
            self._hip_m[name] = data.oMi[chain[0]].translation - com
        hip = next(iter(self._hip_m.values()))
        self._hip_height_m = self._com_height_m + float(hip[2])
        ankle = min(float(data.oMi[j].translation[2]) for j in range(1, robot.model.njoints))
        self._ankle_m = ankle
        self._leg_m = self._longest_leg_m(data)
        nominal = abs(place[self._soles[0]][1] - place[self._soles[1]][1])
        half = robot.effectors[self._soles[0]].contact_half_size_m or (0.05, 0.03)
        leg = self._leg_m
        self.limits = StepLimits(
            settings.ahead * leg, settings.back * leg, (max(0.85 * nominal, 2 * half[1] + 0.03), settings.aside * leg),
            nominal, half,
        )
        self._chooser = StepChooser(self.limits, self._footholds)
        self._half = np.array(half)
        self.contacts: dict[str, Contact] = {}
        self._swing: AimedSwing | None = None
        self._swing_name: str | None = None
        self.step: Step | None = None
        self._since = 0
        self._n_steps = 0
        self.rest_s = 0.0
        self.unsolved = 0
        self.track: list = []
        self.events: list[tuple[float, str]] = []
        self.time_s = 0.0

    def _longest_leg_m(self, data: pin.Data) -> float:
        model, robot = self._robot.model, self._robot
        frame = model.frames[model.getFrameId(robot.effectors[self._soles[0]].frame)]
        chain = [j for j in model.supports[frame.parentJoint] if robot.group.get(model.names[j]) == "leg"]
        at = [data.oMi[j].translation for j in chain]
        knee = at[3]
        return float(np.linalg.norm(knee - at[0]) + np.linalg.norm(at[4] - knee))

    def begin(self, measured: SensedState, planned: Mapping[str, Contact], time_s: float) -> None:
        """Take over at a measured state, with the soles of ``planned`` in contact."""
        self._body.update(measured.q, measured.v)
        self.time_s = time_s
        self.events.append((time_s, 'begin'))
        for name in self._soles:
            loaded = float(np.linalg.norm(measured.forces_n[name])) > self._loaded_n
            if name in planned and (loaded or len([n for n in planned if n in self._soles]) == 1):
                self._put_down(name, measured)
        if not self.contacts:
            loads = {n: float(np.linalg.norm(measured.forces_n[n])) for n in self._soles}
            self._put_down(max(loads, key=loads.__getitem__), measured)
        yaw = [c.placement.rotation[:2, 0] for c in self.contacts.values()]
        base = self._body.frame_state("base").rotation[:2, 0]
        ahead = np.mean([*yaw, base], axis=0)
        ahead /= np.linalg.norm(ahead)
        self._axes = np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])
        self._R = np.eye(3)
        self._R[:2, :2] = self._axes
        self._z_m = float(self._body.com_m[2])
        self._z_rate = float(np.clip(self._body.com_v_m_s[2], -0.3, 0.3))
        for name in self._soles:
            if name not in self.contacts:
                self._lift(name, measured)
        self._rebuild()

    def _put_down(self, name: str, measured: SensedState) -> None:
        at = measured.contacts[name]
        self.contacts[name] = Contact(
            name, at, "", self._sequence.friction, "surface", self._robot.effectors[name].contact_half_size_m
        )

    def _lift(self, name: str, measured: SensedState) -> None:
        frame = self._body.frame_state(name)
        self._swing = AimedSwing(frame.position_m, frame.velocity[:3])
        self._swing_name, self.step, self._since = name, None, 0
        self._lifted_s = self.time_s
        self._on_ground = float(np.linalg.norm(measured.forces_n[name])) > 5.0

    def _rebuild(self) -> None:
        self._rows = BalanceRows(
            self._robot, self._body, self.contacts, self._by.weights, self._rows_settings, self._avoidance
        )

    def compute_command(self, measured: SensedState, time_s: float) -> Command:
        """Joint command for the measured state."""
        self.time_s = time_s
        body = self._body
        body.update(measured.q, measured.v)
        ground = min(c.placement.position_m[2] for c in self.contacts.values())
        h = max(float(body.com_m[2]) - ground, 0.3)
        w = float(np.sqrt(GRAVITY_M_S2 / h))
        xi = body.com_m[:2] + body.com_v_m_s[:2] / w
        if TRACE:
            cop = []
            for n, c in self.contacts.items():
                f, m = measured.forces_n[n], measured.moments_nm[n]
                q = self._axes.T @ (np.array([-m[1], m[0]]) / max(f[2], 1.0))
                cop.append((n[0], int(f[2]), q.round(2).tolist()))
            self._last_f = cop
        if self._swing is not None:
            self._check_landing(measured)
        if self._swing is None:
            pressure = self._stand(xi, w, measured)
        if self._swing is not None:
            pressure = self._swing_on(xi, w)
        if TRACE2 and self._swing is not None:
            (n, c), = self.contacts.items()
            f, m = measured.forces_n[n], measured.moments_nm[n]
            got = np.array([-m[1], m[0]]) / max(f[2], 1.0) + measured.contacts[n].position_m[:2]
            if getattr(self, "_wish", None) is not None and self._swing is not None and f[2] > 50:
                self.track.append([*(got - self._wish), f[2]])
        self._wish = pressure
        height, rate = self._height()
        com_a = w * w * (body.com_m[:2] - pressure)
        swings = {}
        if self._swing is not None and self._swing_name is not None:
            s = self._swing
            swings[self._swing_name] = SwingTarget(Placement(s.p.copy(), self._R), s.v.copy(), s.a.copy())
        a, tau, met = self._rows.solve(BalanceTargets(com_a, height, rate, self._R, swings))
        self.unsolved += not met
        if TRACE_N == 1 and TRACE:
            fz = {n[0]: int(f.sum(axis=0)[2]) for n, f in self._rows.last_forces.items()}
            real = {n[0]: int(f[2]) for n, f in measured.forces_n.items()}
            data = body.data
            acc = body.A_g[2] @ a / body.mass_kg + body.A_g_drift[2] / body.mass_kg
            print(f"{time_s:.3f} qp {fz} before {real} com a {acc:.1f} vz {body.com_v_m_s[2]:.2f} wish z {height:.3f} {body.com_m[2]:.3f} swing a {swings and next(iter(swings.values())).acceleration_m_s2.round(0)} v {swings and next(iter(swings.values())).velocity_m_s.round(1)} stancev {[body.frame_state(n).velocity[:3].round(2).tolist() for n in self.contacts]}")
        return Command(tau, measured.q[7:].copy(), measured.v[6:].copy(), a[6:])

    def _check_landing(self, measured: SensedState) -> None:
        name = self._swing_name
        assert name is not None and self._swing is not None
        loaded = float(np.linalg.norm(measured.forces_n[name])) > self._loaded_n
        aloft = self.time_s - self._lifted_s
        if not loaded:
            self._on_ground = False
        near = self.step is not None and (self.step.in_s < 0.10 or self._swing.landing)
        if loaded and not self._on_ground and (near or aloft > 0.2):
            self._put_down(name, measured)
            self._swing, self._swing_name, self.step = None, None, None
            self._n_steps += 1
            self.events.append((self.time_s, f"landed {name}"))
            self._rebuild()

    def _stand(self, xi: np.ndarray, w: float, measured: SensedState) -> np.ndarray:
        a, b = (self.contacts[name].placement.position_m for name in self._soles)
        local = (xi - a[:2]) @ self._axes
        end = (b[:2] - a[:2]) @ self._axes
        inner = self._half - self._by.margin_m
        excess, nearest = segment_excess(local[None], end[None], inner)
        target = 0.5 * end
        p = local + self._by.gain * (local - target)
        # pressure in the hull: nearest to the wished one
        length2 = float(end @ end)
        share = float(np.clip(p @ end / max(length2, 1e-9), 0.0, 1.0))
        near = share * end
        p = near + np.clip(p - near, -inner, inner)
        if float(excess[0]) > self._by.step_excess_m:
            best: tuple[float, str, Step] | None = None
            for name in self._soles:
                other = next(n for n in self._soles if n != name)
                step = self._chooser.choose(
                    xi, w, self.contacts[other].placement.position_m, self.contacts[name].placement.position_m,
                    np.zeros(3), self._axes, self._side[name], False, None,
                )
                if step is not None and (best is None or step.cost < best[0]):
                    best = (step.cost, name, step)
            if best is not None:
                self.contacts.pop(best[1])
                self._lift(best[1], measured)
                self.step = best[2]
                self._set_apex(best[2])
                self._rebuild()
                self.events.append((self.time_s, f"lift {best[1]} in {best[2].in_s:.2f} cost {best[2].cost:.2f}"))
        speed = float(np.linalg.norm(self._body.com_v_m_s[:2]))
        self.rest_s = self.rest_s + self._dt_s if self._swing is None and speed < 0.05 else 0.0
        return np.asarray(a[:2] + self._axes @ p)

    def _set_apex(self, step: Step) -> None:
        s = self._swing
        assert s is not None
        corners = (np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * (self._half + 0.01)) @ self._axes.T
        top = max(self._footholds.highest_m(s.p[:2], step.place_m, corners), step.height_m)
        s.clear_m = top + 0.05

    def _swing_on(self, xi: np.ndarray, w: float) -> np.ndarray:
        name, swing = self._swing_name, self._swing
        assert name is not None and swing is not None
        stance = next(n for n in self._soles if n != name)
        at = self.contacts[stance].placement.position_m
        if self.step is not None:
            s = self.step
            self.step = Step(s.place_m, s.height_m, s.in_s - self._dt_s, s.capture_m, s.pressure_m, s.cost)
        if self.step is None or (self.step.in_s > self._by.frozen_s and self._since % self._by.choose_every == 0):
            aloft = swing.p[2] > at[2] + 0.02 and self.time_s - self._lifted_s > 0.08 or self._n_steps == 0
            step = self._chooser.choose(
                xi, w, at, swing.p, swing.v, self._axes, self._side[name], bool(aloft), self.step,
                wait_s=0.0 if aloft else -min(self.time_s - self._lifted_s, 0.15),
            )
            if step is not None:
                self.step = step
                self._set_apex(step)
        self._since += 1
        inner = self._half - self._by.margin_m
        if TRACE and self._since % TRACE_N == 1 % TRACE_N and self.step is not None:
            L = (xi - at[:2]) @ self._axes
            st = self.step
            u = (st.place_m - at[:2]) @ self._axes
            sw = (swing.p[:2] - at[:2]) @ self._axes
            me = self._body.frame_state(name).position_m
            mel = (me[:2] - at[:2]) @ self._axes
            rc = (st.capture_m - at[:2]) @ self._axes
            f = self._last_f
            print(f"  t{self.time_s:.2f} swing {name} xi {L.round(2)} u {u.round(2)} T {st.in_s:.2f} xiT {rc.round(2)} cost {st.cost:.1f} sw {sw.round(2)} z {swing.p[2]:.2f} real {mel.round(2)} {me[2]:.2f} com z {self._body.com_m[2]:.2f}/{self._z_m:.2f} cop {f} tilt {np.degrees(np.arccos(min(1,self._body.frame_state('base').rotation[2,2]))):.0f} uns {self.unsolved}", flush=True)
        if self.step is None:
            return np.asarray(at[:2])
        growth = float(np.exp(w * max(self.step.in_s, 0.02)))
        local = (xi - at[:2]) @ self._axes
        wish = local * growth / (growth - 1.0)
        p = np.clip(wish, -inner, inner)
        p = p + np.clip(wish - p, -self._by.hip, self._by.hip)
        frame = self._body.frame_state(name)
        swing.follow(frame.position_m, frame.velocity[:3])
        swing.advance(self.step.place_m, self.step.height_m, self.step.in_s, self._dt_s)
        return np.asarray(at[:2] + self._axes @ p)

    def _height(self) -> tuple[float, float]:
        """Height of the CoM: the usual one above the lower of the soles, less where a leg would be too short."""
        com = self._body.com_m
        feet = [c.placement.position_m for c in self.contacts.values()]
        if self.step is not None:
            feet.append(np.array([*self.step.place_m, self.step.height_m]))
        wish = min(f[2] for f in feet) + self._com_height_m
        if len(feet) == 2 and abs(feet[0][2] - feet[1][2]) > 0.02:
            wish = 0.5 * (feet[0][2] + feet[1][2]) + self._com_height_m
        hip_up = self._hip_height_m - self._com_height_m
        for f, name in zip(feet, list(self.contacts) + [self._swing_name], strict=False):
            side = self._side[name] if name else 0.0
            hip = com[:2] + self._axes @ np.array([0.0, side * abs(next(iter(self._hip_m.values()))[1])])
            d = float(np.linalg.norm(hip - f[:2]))
            L = self._by.straight * self._leg_m
            up = float(np.sqrt(max(L * L - d * d, (0.6 * L) ** 2)))
            wish = min(wish, f[2] + self._ankle_m + up - hip_up)
        rate = float(np.clip((wish - self._z_m) / 0.12, -0.7, 0.5))
        self._z_rate += float(np.clip(rate - self._z_rate, -6 * self._dt_s, 6 * self._dt_s))
        self._z_m += self._z_rate * self._dt_s
        return self._z_m, self._z_rate

    def is_upright(self, com_m: np.ndarray) -> bool:
        """Whether the CoM is above 0.6 of its usual height over the lowest sole, and the base tilts by less than 60 deg."""
        ground = min(c.placement.position_m[2] for c in self.contacts.values())
        tilt = float(self._body.frame_state("base").rotation[2, 2])
        return bool(com_m[2] - ground > 0.6 * self._com_height_m and tilt > 0.5)
