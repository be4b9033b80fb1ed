"""Random contact sets: two to four bodies, soles and hands, tilted, spread over metres."""

import numpy as np
from scipy.spatial.transform import Rotation

from stridelab.contacts.point_contacts import PointContacts
from stridelab.dynamics.placement import Placement

TILT_RAD = 0.35
SOLE_M = (0.1, 0.06)


def random_contacts(rng: np.random.Generator, bodies: int) -> PointContacts:
    """Seven bodies of ten are soles; every component of the tilt up to 20 degrees, friction 0.3 to 0.9."""
    rows = []
    for _ in range(bodies):
        tilt = Rotation.from_rotvec(np.append(rng.uniform(-TILT_RAD, TILT_RAD, 2), 0.0))
        turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
        at = Placement(rng.uniform(-1.5, 1.5, 3), (tilt * turn).as_matrix())
        rows.append((at, SOLE_M if rng.random() < 0.7 else None, float(rng.uniform(0.3, 0.9))))
    return PointContacts.of(rows)


def com_m(contacts: PointContacts) -> np.ndarray:
    """A place for the CoM: 0.8 m above the middle of the contacts."""
    return np.asarray(contacts.position_m.mean(axis=0) + np.array([0.0, 0.0, 0.8]))


def random_wrench(rng: np.random.Generator, contacts: PointContacts) -> np.ndarray:
    """About what a robot of 90 kg asks for, about the world origin."""
    force = np.array([0.0, 0.0, 900.0]) + rng.normal(0.0, 200.0, 3)
    at = com_m(contacts) + rng.normal(0.0, 0.3, 3)
    return np.concatenate([force, np.cross(at, force) + rng.normal(0.0, 20.0, 3)])
