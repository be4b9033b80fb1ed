"""A motion in physics that goes on while it is watched: pushes, settings, rewinding, and explained falls.

The same control as in the replay of ``plan-motion`` carries out the motion. At its end the robot stands. After a
recovery it stands where it came to rest while the rest of its plan is computed (``resuming``), and then goes on. Once
it is steered, it walks at the commanded velocity where the ground is level.
"""

import math
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np

from stridelab.conventions import Vector3
from stridelab.errors import InvalidInput
from stridelab.pipelines.live.fall import Strain, explain_fall
from stridelab.pipelines.live.horizon import predict_horizon
from stridelab.pipelines.live.resuming import PlanResuming
from stridelab.pipelines.live.snapshots import SavedState, restore_state, save_state
from stridelab.pipelines.live.world import AdjustableWorld
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.robots.visuals import link_names, link_poses
from stridelab.schemas.live.messages import (
    REWIND_S,
    STEER_HOLD_S,
    LiveFall,
    LiveFoothold,
    LiveFrame,
    LivePush,
    LivePushState,
    LiveSettings,
    LiveSteer,
)
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.recovery.driven_joints import DrivenJoints
from stridelab.wholebody.recovery.recovery import Recovery
from stridelab.wholebody.recovery.walking import WalkCommand, WalkRun
from stridelab.wholebody.replay.dcm_feedback import pendulum_rate
from stridelab.wholebody.replay.disturbances import UNDISTURBED, Push
from stridelab.wholebody.replay.log import LOADED_N, TORQUE_RATIO, ReplayLog, TorquePeak
from stridelab.wholebody.replay.loss_proof import LossPremises
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.resumption import Resume
from stridelab.wholebody.replay.sensors import as_sensed
from stridelab.wholebody.replay.stepper import ReplayStepper

SAVE_EVERY_S: Final = 1.0
COLLAPSE_S: Final = 1.5
"""Duration for which a fallen robot is simulated further, without control."""
LOG_S: Final = 15.0
"""Length of the recorded past, from which a fall is explained."""
PUSH_SHOWN_S: Final = 3.0
"""Time for which frames describe a push; a slow viewer misses many frames."""
MAX_PUSHES: Final = 8
"""Pushes that act at a time."""
BROKEN: Final = "The motion cannot be computed any further: a push or a setting was beyond all measure."
_DIGITS: Final = 4
_ROUNDING_S: Final = 1e-9


class LiveReplay:
    """``motion`` of ``robot`` in physics, advanced in real time; ``fall`` is the fall, until a rewind or restart.

    ``resume`` plans what is left of the motion after a recovery. Raises as ``PhysicsReplay.run``.
    """

    def __init__(
        self, robot: Robot, motion: WholeBodyMotion, proxies: Mapping[str, Proxy], resume: Resume | None = None
    ) -> None:
        self._robot, self._motion = robot, motion
        physics = PhysicsReplay(recovery=replace(Recovery(), most_s=np.inf))
        self._stepper = ReplayStepper(physics, robot, motion.sequence, motion, as_sensed, UNDISTURBED)
        self._resuming = PlanResuming(self._stepper, resume)
        self._world = AdjustableWorld(self._stepper.simulation, motion.sequence)
        self._premises = LossPremises.of_sequence(robot, motion.sequence, proxies)
        self.settings = LiveSettings()
        self._world.apply_settings(self.settings)
        self.links = link_names(robot)
        self._drawn = {self._stepper.simulation.built.body_of(name): k for k, name in enumerate(self.links)}
        self.fall: LiveFall | None = None
        self._has_diverged = False
        self._pushes: list[Push] = []
        self._pushed_link: int | None = None
        self._push_number, self._owed_s, self._steps, self._strain = -1, 0.0, 0, Strain()
        self._steer_until_s = -np.inf
        self._start = save_state(self._stepper)
        self._saved: deque[SavedState] = deque(maxlen=round(REWIND_S / SAVE_EVERY_S) + 1)
        self._begin_at(self._start)

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self._stepper.time_s

    @property
    def base_pose(self) -> tuple[Vector3, float]:
        """Position (m) and heading (rad) of the base link."""
        q, _ = self._stepper.simulation.coordinates()
        x, y, z, w = q[3:7]
        return q[:3].copy(), math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def is_recovering(self) -> bool:
        """Whether the robot steps to stay upright, rather than as planned or commanded."""
        return self._current_activity() == "recovery"

    @property
    def has_stopped(self) -> bool:
        """Whether nothing moves any more after a fall."""
        return self.fall is not None and (self._has_diverged or self.time_s > self.fall.time_s + COLLAPSE_S)

    @property
    def can_rewind_s(self) -> float:
        """How far a rewind would go back."""
        return self.time_s - self._rewind_target().time_s

    def push_link(self, push: LivePush) -> None:
        """Push now. Raises ``InvalidInput`` (``link-not-found``, ``too-many-pushes``)."""
        self.add_push(Push(self.time_s, push.impulse_ns, link=push.link))
        self._push_number = -1 if push.number is None else push.number

    def add_push(self, push: Push) -> None:
        """Add a push that begins now or later. Raises as ``push_link``."""
        self._stepper.drop_ended_pushes()
        if sum(one.end_s > self.time_s for one in self._pushes) >= MAX_PUSHES:
            raise InvalidInput("too-many-pushes", f"{MAX_PUSHES} pushes act at this moment already.")
        self._stepper.add_push(push)
        self._pushes = [*self._pushes[-20:], push]
        self._strain, self._push_number = Strain(), -1
        self._resuming.cancel_planning()
        self._pushed_link = self._drawn.get(self._stepper.simulation.built.body_of(push.link))

    def leave_joints(self, driven: DrivenJoints) -> None:
        """Leave joints to their own servo from now on."""
        self._stepper.leave_joints(driven)

    def steer(self, command: LiveSteer, hold_s: float = STEER_HOLD_S) -> None:
        """Walk at a commanded velocity, for ``hold_s``. Raises ``InvalidInput`` (``robot-cannot-steer``)."""
        self._resuming.cancel_planning()
        self._stepper.steer(WalkCommand(command.ahead_m_s, command.left_m_s, command.turn_rad_s))
        self._steer_until_s = self.time_s + hold_s

    def apply_settings(self, settings: LiveSettings) -> None:
        """Use new settings from now on; a rewind keeps them."""
        self._world.apply_settings(settings)
        before, self.settings = self.settings, settings
        if (settings.delay_s, settings.expected_delay_s) != (before.delay_s, before.expected_delay_s):
            self._stepper.set_delay(settings.delay_s, settings.expected_delay_s)

    def rewind(self) -> None:
        """Go back by ten seconds, or as far as possible, and on from there."""
        self._begin_at(self._rewind_target())

    def restart(self) -> None:
        """Go back to the beginning of the motion."""
        self._saved.clear()
        self._begin_at(self._start)

    def advance(self, duration_s: float, budget_s: float) -> float:
        """Simulate ``duration_s``, or what ``budget_s`` of real time allows; returns the simulated time (s)."""
        began_s, began, dt_s = time.perf_counter(), self.time_s, 1.0 / self._motion.rate_hz
        self._owed_s += duration_s
        while self._owed_s > dt_s - _ROUNDING_S and not self.has_stopped:
            self._advance_sample()
            self._owed_s -= dt_s
            if time.perf_counter() - began_s > budget_s:
                self._owed_s = 0.0
        if self.has_stopped:
            self._owed_s = 0.0
        return self.time_s - began

    def frame(self) -> LiveFrame:
        """The present instant."""
        stepper, simulation = self._stepper, self._stepper.simulation
        q, _ = simulation.coordinates()
        (com_m, com_v_m_s), forces = simulation.com_state(), simulation.forces_n()
        places_m = {name: simulation.contact_placement(name).position_m for name in forces}
        soles_m = [place[2] for name, place in places_m.items() if self._robot.effectors[name].kind == "surface"]
        ground_m = float(min(soles_m, default=0.0))
        capture_m = com_m[:2] + com_v_m_s[:2] / pendulum_rate(max(float(com_m[2]) - ground_m, 0.05))
        recovering = stepper.recovering
        aim = None if recovering is None or self.fall is not None else recovering.next_foothold_m
        path_m, footholds = ([], ()) if self.fall is not None else predict_horizon(stepper)
        return LiveFrame.model_construct(
            time_s=round(self.time_s, _DIGITS),
            plan_time_s=round(stepper.plan_time_s, _DIGITS),
            doing=self._current_activity(),
            is_planning=self._resuming.is_planning,
            not_resumed=self._resuming.reason,
            velocity=recovering.velocity if isinstance(recovering, WalkRun) else None,
            steps=0 if recovering is None else self._steps + recovering.steps,
            links=np.round(link_poses(self._robot, q), _DIGITS).tolist(),
            com_m=_rounded(com_m),
            capture_m=_rounded(capture_m),
            ground_m=round(ground_m, _DIGITS),
            effectors_m={name: _rounded(place) for name, place in places_m.items()},
            contacts=[name for name, force in forces.items() if float(np.linalg.norm(force)) > LOADED_N],
            forces_n={name: tuple(np.round(force, 1).tolist()) for name, force in forces.items()},
            foothold_m=None if aim is None else _rounded(aim),
            horizon_m=[_rounded(place) for place in path_m],
            footholds=[
                LiveFoothold.model_construct(effector=name, position_m=_rounded(at), yaw_rad=round(yaw, _DIGITS))
                for name, at, yaw in footholds
            ],
            push=self._push_state(),
        )

    def _current_activity(self) -> Literal["plan", "steered", "recovery", "fallen"]:
        recovering = self._stepper.recovering
        if self.fall is not None:
            return "fallen"
        if recovering is None:
            return "plan"
        return "steered" if isinstance(recovering, WalkRun) and recovering.is_as_commanded else "recovery"

    def _push_state(self) -> LivePushState | None:
        if not self._pushes or self.time_s > self._pushes[-1].time_s + PUSH_SHOWN_S:
            return None
        push = self._pushes[-1]
        return LivePushState.model_construct(
            number=self._push_number,
            link=self._pushed_link,
            impulse_ns=push.impulse_ns,
            force_n=tuple(push.force_n(self.time_s).tolist()),
            since_s=round(self.time_s - push.time_s, _DIGITS),
        )

    def _advance_sample(self) -> None:
        stepper = self._stepper
        if self.fall is not None:
            stepper.collapse()
            return
        if isinstance(stepper.recovering, WalkRun) and self.time_s > self._steer_until_s:
            stepper.recovering.command = WalkCommand()
        try:
            stepper.advance()
            is_finite = bool(np.isfinite(stepper.simulation.joint_rates_rad_s).all())
        except (np.linalg.LinAlgError, ValueError, FloatingPointError):
            is_finite = False
        if not is_finite:
            self.fall = LiveFall(time_s=self.time_s, summary=BROKEN, reasons=[])
            self._has_diverged = True
            self._resuming.cancel_planning()
            return
        self._note_strain()
        recovering = stepper.recovering
        if not stepper.standing:
            self._resuming.cancel_planning()
            self.fall = self._explain_fall()
        elif recovering is not None and recovering.at_rest and not isinstance(recovering, WalkRun):
            self._steps += recovering.steps
            if not self._resuming.follow_rest():
                stepper.renew_recovery()
        if self.time_s - self._saved[-1].time_s >= SAVE_EVERY_S - 1e-6 and self.fall is None:
            self._save()

    def _note_strain(self) -> None:
        stepper = self._stepper
        if self._strain.time_s is None and stepper.torque_peak.ratio > TORQUE_RATIO:
            self._strain = Strain(stepper.torque_peak.joint, stepper.torque_peak.time_s)
        stepper.torque_peak = TorquePeak()

    def _explain_fall(self) -> LiveFall:
        replay = self._stepper.to_replay(1.0)
        return explain_fall(self._robot, self._stepper, replay, self._pushes, self._premises, self._strain)

    def _save(self) -> None:
        self._stepper.drop_ended_pushes()
        self._saved.append(save_state(self._stepper))
        self._stepper.log.trim_samples(round(LOG_S * self._motion.rate_hz))

    def _rewind_target(self) -> SavedState:
        before = [state for state in self._saved if state.time_s <= self.time_s - REWIND_S + 1e-6]
        return before[-1] if before else self._saved[0]

    def _begin_at(self, state: SavedState) -> None:
        """Go on from ``state`` with the present settings; pushes and the fall after it have not happened."""
        self._resuming.cancel_planning()
        restore_state(self._stepper, state)
        self._stepper.log = ReplayLog(self._robot, self._stepper.motion.sequence)
        self._world.apply_settings(self.settings)
        self._stepper.set_delay(self.settings.delay_s, self.settings.expected_delay_s)
        while self._saved and self._saved[-1].time_s > state.time_s:
            self._saved.pop()
        if not self._saved:
            self._saved.append(state)
        self.fall, self._has_diverged, self._pushes, self._pushed_link = None, False, [], None
        self._steer_until_s = self.time_s
        self._push_number, self._owed_s, self._steps, self._strain = -1, 0.0, 0, Strain()


def _rounded(values: np.ndarray) -> Any:
    return tuple(np.round(values, _DIGITS).tolist())
