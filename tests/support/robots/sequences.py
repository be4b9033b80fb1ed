"""Contact sequences, effectors and reachability mixtures made by hand, for tests that need no robot and no files."""

import numpy as np

from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Box, Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Effector

MASS_KG = 90.0
COM_HEIGHT_M = 0.82
FOOT_Y_M = 0.09

EFFECTORS = {
    "left_foot": Effector("left_foot", "left_sole", "surface", Placement.identity(), (0.10, 0.06)),
    "right_foot": Effector("right_foot", "right_sole", "surface", Placement.identity(), (0.10, 0.06)),
    "right_hand": Effector("right_hand", "right_gripper", "point", Placement.identity()),
}


def foot(side: str, x_m: float, z_m: float = 0.0, friction: float = 0.3) -> Contact:
    y = FOOT_Y_M if side == "left" else -FOOT_Y_M
    return Contact(f"{side}_foot", Placement.from_wxyz((x_m, y, z_m)), "ground", friction)


def hand(x_m: float, z_m: float, slope: float = 0.0, friction: float = 0.3) -> Contact:
    half = -np.arctan(slope) / 2
    place = Placement.from_wxyz((x_m, -0.5, z_m), (np.cos(half), 0.0, np.sin(half), 0.0))
    return Contact("right_hand", place, "rail", friction)


def phase(duration_s: float, *contacts: Contact) -> ContactPhase:
    return ContactPhase(duration_s, {contact.effector: contact for contact in contacts})


def sequence(*phases: ContactPhase, name: str = "by hand") -> ContactSequence:
    ground = Box("ground", Placement.from_wxyz((0.0, 0.0, -0.05)), np.array([10.0, 10.0, 0.1]))
    return ContactSequence(name, "nobody", 0.3, Terrain((ground,)), phases)


def two_steps(step_m: float = 0.2, friction: float = 0.3) -> ContactSequence:
    """Right, then left foot ``step_m`` ahead: 3.4 s."""
    left, right = foot("left", 0.0, friction=friction), foot("right", 0.0, friction=friction)
    left_ahead, right_ahead = foot("left", step_m, friction=friction), foot("right", step_m, friction=friction)
    return sequence(
        phase(0.6, left, right),
        phase(0.8, left),
        phase(0.3, left, right_ahead),
        phase(0.8, right_ahead),
        phase(0.9, left_ahead, right_ahead),
    )


def mirrored(walk: ContactSequence) -> ContactSequence:
    """The same walk seen in a mirror: y changes sign, left and right their names (contacts must be level)."""
    names = {"left_foot": "right_foot", "right_foot": "left_foot"}

    def flip(contact: Contact) -> Contact:
        position = contact.placement.position_m * np.array([1.0, -1.0, 1.0])
        return Contact(names[contact.effector], Placement(position, np.eye(3)), contact.surface, contact.friction)

    phases = [ContactPhase(p.duration_s, {c.effector: c for c in map(flip, p.contacts.values())}) for p in walk.phases]
    return sequence(*phases, name="mirrored")


def foot_mixture(side: str) -> Mixture:
    """Seven components along an arc of 0.85 m over the ankle, in the sole's frame."""
    angle = np.deg2rad(np.arange(-36.0, 37.0, 12.0))
    weights = np.exp(-0.5 * (angle / np.deg2rad(22.0)) ** 2)
    y = 0.085 if side == "right" else -0.085
    means = np.column_stack([0.85 * np.sin(angle), np.full(7, y), 0.85 * np.cos(angle)])
    return Mixture(weights / weights.sum(), means, _tilted(angle, (0.09, 0.07, 0.055)))


def hand_mixture() -> Mixture:
    """Seven components around a place behind, left of and below the right hand."""
    angle = np.deg2rad(np.arange(-60.0, 61.0, 20.0))
    means = np.column_stack([-0.30 + 0.25 * np.sin(angle), np.full(7, 0.42), -0.10 + 0.10 * np.cos(angle)])
    return Mixture(np.full(7, 1.0 / 7.0), means, _tilted(angle, (0.16, 0.12, 0.14)))


def _tilted(angle: np.ndarray, sd_m: tuple[float, float, float]) -> np.ndarray:
    covariances = []
    for a in angle:
        R = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
        S = R @ np.diag(np.square(sd_m)) @ R.T
        covariances.append((S + S.T) / 2)
    return np.array(covariances)


MIXTURES = {
    "left_foot": foot_mixture("left"),
    "right_foot": foot_mixture("right"),
    "right_hand": hand_mixture(),
}
PROXIES = {name: Proxy(mixture) for name, mixture in MIXTURES.items()}
