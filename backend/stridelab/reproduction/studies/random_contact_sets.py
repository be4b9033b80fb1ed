"""Random contact sets and wrenches for the cones of section 4.4, and the three sets of figure 4.7."""

from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.wrench_cones.contact_points import PointContacts
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.reproduction.studies.proxy_accuracy import stair_contacts

TILT_RAD: Final = 0.35
SOLE_M: Final = (0.1, 0.06)
FRICTION: Final = 0.5


def random_contacts(rng: np.random.Generator, bodies: int) -> PointContacts:
    """Random contacts within 3 m; 70 % are soles; tilts up to 20 degrees, friction 0.3 to 0.9."""
    rows = []
    for _ in range(bodies):
        tilt = ScipyRotation.from_rotvec(np.append(rng.uniform(-TILT_RAD, TILT_RAD, 2), 0.0))
        turn = ScipyRotation.from_euler("z", rng.uniform(-np.pi, np.pi))
        at = Placement(rng.uniform(-1.5, 1.5, 3), (tilt * turn).as_matrix())
        rows.append((at, SOLE_M if rng.random() < 0.7 else None, float(rng.uniform(0.3, 0.9))))
    return PointContacts.from_placements(rows)


def com_m(contacts: PointContacts) -> Vector3:
    """CoM position 0.8 m above the mean of the contacts."""
    return np.asarray(contacts.position_m.mean(axis=0) + np.array([0.0, 0.0, 0.8]))


def random_wrench(rng: np.random.Generator, contacts: PointContacts) -> Float[np.ndarray, "6"]:
    """Random wrench about the world origin, of the magnitude required by a robot of 90 kg."""
    force = np.array([0.0, 0.0, 900.0]) + rng.normal(0.0, 200.0, 3)
    at = com_m(contacts) + rng.normal(0.0, 0.3, 3)
    return np.concatenate([force, np.cross(at, force) + rng.normal(0.0, 20.0, 3)])


def stair_sets(robot_name: str) -> dict[str, PointContacts]:
    """Contact sets of figure 4.5 with two, three and four contacts and friction ``FRICTION``."""
    shapes = effector_shapes(robot_name)
    return {
        name: PointContacts.from_placements(
            (at, shapes[effector].half_size_m, FRICTION) for effector, at in placements.items()
        )
        for name, placements in stair_contacts(robot_name).items()
    }
