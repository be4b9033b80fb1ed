"""Plans and motions for tests: made by hand, or run.

By hand: three phases of TALOS whose right foot takes one step of 0.2 m, every number a known function of time, point
and axis; and a plan in closed form, in which the CoM sways over two standing feet. Run: ``plan-motion`` with all that
it left, and with solvers that do not do what they should.
"""

import ctypes
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pyarrow.parquet as pq

from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput, PlanMotionSummary, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.plan_motion import run as plan_motion
from stridelab.service.processes.child import with_json
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion, WholeBodyStopped
from support.command_line import RecordedProgress

RATE_HZ = 250.0
FEET = ("left_foot", "right_foot")


@cache
def talos() -> Robot:
    return load_robot("talos")


def contact(effector: str, x_m: float) -> Contact:
    y_m = 0.09 if effector == "left_foot" else -0.09
    return Contact(effector, Placement.from_wxyz((x_m, y_m, 0.0)), "ground", 0.5)


def one_step() -> ContactSequence:
    """0.5 s on both feet, 1 s on the left one, 0.5 s on both."""
    terrain = Terrain.from_surfaces(
        [
            Box("ground", Placement.from_wxyz((0.0, 0.0, -0.05)), np.array([4.0, 2.0, 0.1])),
            Rail("rail", np.array([0.0, -0.5, 0.8]), np.array([1.0, -0.5, 1.3]), 0.02),
        ]
    )
    left = contact("left_foot", 0.0)
    phases = (
        ContactPhase(0.5, {"left_foot": left, "right_foot": contact("right_foot", 0.0)}),
        ContactPhase(1.0, {"left_foot": left}),
        ContactPhase(0.5, {"left_foot": left, "right_foot": contact("right_foot", 0.2)}),
    )
    return ContactSequence("one step", "talos", 0.5, terrain, phases)


def corners_m() -> np.ndarray:
    return np.array([[0.08, 0.045, 0.0], [-0.08, 0.045, 0.0], [-0.08, -0.045, 0.0], [0.08, -0.045, 0.0]])


def forces_n(time_s: np.ndarray) -> dict[str, np.ndarray]:
    """Half the weight on each foot, all of it on the left one between 0.5 and 1.5 s; corner k carries k + 1 parts."""
    air = (time_s >= 0.5 - 1e-9) & (time_s < 1.5 - 1e-9)
    parts = np.arange(1.0, 5.0) / 10.0
    share = {"left_foot": np.where(air, 1.0, 0.5), "right_foot": np.where(air, 0.0, 0.5)}
    direction = np.array([0.1, -0.05, 1.0])
    return {foot: 880.0 * share[foot][:, None, None] * parts[None, :, None] * direction for foot in FEET}


def made_up_plan(*, converged: bool = True, iterations: int = 14) -> CentroidalPlan:
    sequence = one_step()
    time_s = np.linspace(0.0, 2.0, 41)
    track = np.column_stack([time_s, np.sin(time_s), 0.86 + 0.01 * np.cos(time_s)])
    return CentroidalPlan(
        sequence=sequence,
        mass_kg=90.0,
        time_s=time_s,
        phase=np.repeat([0, 1, 2], [10, 20, 10]),
        com_m=track,
        com_v_m_s=2.0 * track,
        com_a_m_s2=3.0 * track[:-1],
        l_nms=4.0 * track,
        forces_n=forces_n(time_s[:-1]),
        points_m=dict.fromkeys(FEET, corners_m()),
        solver="ipopt",
        converged=converged,
        status="Solve_Succeeded" if converged else "Maximum_Iterations_Exceeded",
        iterations=iterations,
        compute_cost_terms=lambda: {"com_acceleration": 1.0, "momentum_rate": 0.5},
        solve_time_s=0.2,
        build_time_s=0.1,
        verification=Verification(1e-9, 1e-9, 1.0, 2.0),
    )


def made_up_motion() -> WholeBodyMotion:
    """Every joint of TALOS swings about the reference posture while the base moves and turns."""
    robot = talos()
    time_s = np.arange(501) / RATE_HZ
    n, nv = len(time_s), robot.model.nv
    v = 0.2 * np.sin(time_s[:, None] + np.arange(nv)[None])
    q = np.stack([pin.integrate(robot.model, robot.q_reference, step) for step in v])
    com_m = np.column_stack([time_s, np.zeros(n), np.full(n, 0.86)])
    return WholeBodyMotion(
        sequence=one_step(),
        rate_hz=RATE_HZ,
        time_s=time_s,
        q=q,
        v=v,
        a=2.0 * v,
        tau_nm=5.0 * v[:, 6:],
        forces_n=forces_n(time_s),
        points_m=dict.fromkeys(FEET, corners_m()),
        com_m=com_m,
        com_v_m_s=com_m + 1.0,
        l_nms=com_m + 2.0,
        com_reference_m=com_m + np.array([0.0, 3e-4, 4e-4]),
        com_v_reference_m_s=com_m + 4.0,
        l_reference_nms=com_m + 5.0,
        failures=(),
        solve_time_s=1.0,
    )


class Planned(NamedTuple):
    folder: Path
    outcome: Outcome
    summary: PlanMotionSummary
    progress: RecordedProgress

    def columns(self, table: str, *names: str) -> np.ndarray:
        read = pq.read_table(self.folder / table)
        return np.column_stack([read[name].to_numpy() for name in names])

    def arrays(self) -> dict[str, np.ndarray]:
        with np.load(self.folder / "motion.npz", allow_pickle=False) as read:
            return dict(read)


def run(folder: Path, scenario: Scenario, **arguments: Any) -> Planned:
    progress = RecordedProgress()
    outcome = plan_motion.run(plan_task(scenario, **arguments), folder, progress)
    return Planned(folder, outcome, PlanMotionSummary.model_validate(outcome.summary), progress)


def short_walk() -> Scenario:
    """Two steps on flat ground: 3.4 s."""
    return Scenario.model_validate(flat_walk(steps=2, timing=Timing(0.8, 0.8, 0.2)))


def changed(scenario: Scenario, change: Callable[[dict[str, Any]], object]) -> Scenario:
    """The scenario after ``change`` was done to its plain form."""
    body = scenario.model_dump(mode="json")
    change(body)
    return Scenario.model_validate(body)


def plan_task(scenario: Scenario | None = None, **arguments: Any) -> PlanMotionTask:
    body = scenario or short_walk()
    return PlanMotionTask(scenario=body, input=PlanMotionInput(scenario=body, **arguments))


def stopping_after(time_s: float) -> Callable[[], Any]:
    """A controller whose motion ends at ``time_s``, for want of torque in a knee."""

    class Stopping:
        def run(self, *arguments: Any) -> WholeBodyMotion:
            motion = WholeBodyController().run(*arguments)
            n = round(time_s * motion.rate_hz) + 1
            cut = {name: value[:n] for name, value in vars(motion).items() if isinstance(value, np.ndarray)}
            forces_n = {name: forces[:n] for name, forces in motion.forces_n.items()}
            phase = motion.sequence.phase_at(time_s)
            names = ["torque of leg_right_4_joint"]
            faults = [Fault(f"phases[{phase}]", f"at {time_s:.2f} s: {names[0]}")]
            part = replace(motion, **cut, forces_n=forces_n)
            raise WholeBodyStopped("The whole body cannot go on.", faults, part, phase, 0, names)

    return Stopping


def plan_with_a_hanging_solver(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """``plan-motion`` in a child whose solver is a native call that never returns."""
    from stridelab.pipelines import plan_centroidal
    from stridelab.service.kinds.plan_motion import run as plan_motion

    plan_centroidal.solve = lambda *_args, **_options: ctypes.PyDLL(None).sleep(600)  # type: ignore[attr-defined]
    return with_json(plan_motion.run)(task, folder, progress)


FRICTION = 0.5
GROUND = Box("ground", Placement.from_wxyz([0.0, 0.0, -0.5]), np.array([4.0, 4.0, 1.0]))


def standing_sequence(duration_s: float) -> ContactSequence:
    """Both soles side by side on the ground."""
    feet = {
        name: Contact(name, Placement.from_wxyz([0.0, y, 0.0]), "ground", FRICTION)
        for name, y in (("left_foot", 0.09), ("right_foot", -0.09))
    }
    phases = (ContactPhase(duration_s, feet),)
    return ContactSequence("sway", "talos", FRICTION, Terrain.from_surfaces([GROUND]), phases)


def sway(robot: Robot, duration_s: float = 4.0, amplitude_m: float = 0.05, period_s: float = 2.0) -> CentroidalPlan:
    """The CoM sways sideways from rest to rest, ``y(t) = A sin(pi t / D)^2 sin(2 pi t / T)``.

    The plan's acceleration is constant between nodes every 10 ms; its forces are those of standing still, half of the
    weight on each foot.
    """
    n = round(duration_s / 0.01) + 1
    t = np.linspace(0.0, duration_s, n)
    h = t[1] - t[0]
    v = np.gradient(amplitude_m * np.sin(np.pi * t / duration_s) ** 2 * np.sin(2.0 * np.pi * t / period_s), h)
    v[[0, -1]] = 0.0
    a = np.diff(v) / h
    y = np.concatenate([[0.0], np.cumsum(v[:-1] * h + 0.5 * a * h * h)])
    zero = np.zeros(n)
    sequence = standing_sequence(duration_s)
    corner = np.array([0.0, 0.0, robot.mass_kg * GRAVITY_M_S2 / 8.0])
    return CentroidalPlan(
        sequence=sequence,
        mass_kg=robot.mass_kg,
        time_s=t,
        phase=np.zeros(n - 1, dtype=np.int64),
        com_m=np.column_stack([zero, y, np.full(n, 0.86)]),
        com_v_m_s=np.column_stack([zero, v, zero]),
        com_a_m_s2=np.column_stack([zero[1:], a, zero[1:]]),
        l_nms=np.zeros((n, 3)),
        forces_n={name: np.tile(corner, (n - 1, 4, 1)) for name in sequence.effectors},
        points_m={name: robot.effectors[name].points_m(0.02) for name in sequence.effectors},
        solver="by hand",
        converged=True,
        status="given",
        iterations=0,
        compute_cost_terms=dict,
        solve_time_s=0.0,
        build_time_s=0.0,
        verification=Verification(0.0, 0.0, 0.0, 0.0),
    )
