"""A contact sequence of three phases with a made-up plan and motion for TALOS: numbers to be written, not believed.

The right foot takes one step of 0.2 m; every number is a known function of time, point and axis.
"""

from functools import cache

import numpy as np
import pinocchio as pin

from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.motion import WholeBodyMotion

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
        objective=1.5,
        cost_terms={"com_acceleration": 1.0, "momentum_rate": 0.5},
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
