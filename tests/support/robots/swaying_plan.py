"""A hand-made centroidal plan whose truth is known in closed form: the CoM sways over two standing feet."""

import numpy as np

from stridelab.centroidal.plan import CentroidalPlan, Verification
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Terrain
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot

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
        objective=0.0,
        cost_terms={},
        solve_time_s=0.0,
        build_time_s=0.0,
        verification=Verification(0.0, 0.0, 0.0, 0.0),
    )
