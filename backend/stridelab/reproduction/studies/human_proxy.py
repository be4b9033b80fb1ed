"""Reachability densities p_i(c) of people, learned as those of the robots (4.3.2) in the measure ``conditioned``.

The variables of a planner are drawn uniformly: the second sole within a step of the first, both flat, and the pose of
the pelvis with the trunk upright (``Stance``). A posture is accepted if both ankles are within reach of their hips. The
knee bends forward; trunk, head and hanging arms are rigid. The centre of mass is that of the Dumas segment table. Joint
limits and self-collision are not checked, and the heel does not rise. The mixture is learned for a stature of 1 m and
scaled.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
import pinocchio as pin

from stridelab.conventions import Points, Series, Vector3
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.learning.fit import expectation_maximisation
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.standing_conditions import Stance
from stridelab.recordings.recording import Sex
from stridelab.simulation.human.body_model import AnthropometricBody, build_body

EXTENSION: Final = (0.58, 1.0)
"""Distance from hip to ankle over the length of the straight leg, on which people walk."""
PERSON: Final = replace(Stance(), aside=(0.05, 0.5))
"""The soles of people come closer to each other than those of robots."""
COMPONENTS: Final = 5
POSTURES: Final = 4000
DRAWN_AT_ONCE: Final = 40_000


def human_proxies(height_m: float, sex: Sex, seed: int = 0) -> Mapping[str, Proxy]:
    """Densities of both soles (``left_foot``, ``right_foot``) of a person of stature ``height_m``, in metres.

    The contact frame has its origin in the middle of the sole, x ahead, y to the left, z up. ``seed`` draws postures.
    """
    of_right = _unit_mixture(sex, seed)
    mirror = np.diag([1.0, -1.0, 1.0])
    means_m, covariances_m2 = height_m * of_right.means_m, height_m**2 * of_right.covariances_m2
    left = Mixture(of_right.weights, means_m @ mirror, mirror @ covariances_m2 @ mirror)
    return {"left_foot": Proxy(left), "right_foot": Proxy(Mixture(of_right.weights, means_m, covariances_m2))}


@cache
def _unit_mixture(sex: Sex, seed: int) -> Mixture:
    """Mixture of the right sole for a stature of 1 m."""
    body, rng = build_body(1.0, 1.0, sex), np.random.default_rng(seed)
    seen = np.zeros((0, 3))
    while len(seen) < POSTURES:
        seen = np.vstack([seen, sample_standing_com(body, DRAWN_AT_ONCE, rng)])
    return expectation_maximisation(seen[:POSTURES], COMPONENTS, seed)[0]


def sample_standing_com(body: AnthropometricBody, n: int, rng: np.random.Generator) -> Points:
    """Centres of mass (m) of the accepted ones of ``n`` postures, in the contact frame of the right sole."""
    p = body.proportions
    leg_m = p.thigh_m + p.shank_m
    sole_to_ankle = np.array([-(p.toe_m - p.heel_m) / 2.0, 0.0, p.ankle_height_m])
    other, yaw = PERSON.draw_soles(n, 1.0, rng)
    trunk = PERSON.draw_trunks(yaw / 2.0, rng)
    hips = leg_m * rng.uniform([-0.8, -0.3, 0.4], [0.8, 0.8, 1.1], (n, 3)) + [0.0, 0.0, p.ankle_height_m]
    ankles = {"r": np.tile(sole_to_ankle, (n, 1)), "l": leg_m * other + _turned(yaw, sole_to_ankle)}
    accepted = PERSON.is_upright(trunk)
    com = _upper_body_moment(body, trunk, hips)
    for side, sign in (("r", -1.0), ("l", 1.0)):
        hip = hips + trunk @ np.array([0.0, sign * p.hip_half_distance_m, 0.0])
        reach = np.linalg.norm(hip - ankles[side], axis=1)
        accepted &= (reach >= EXTENSION[0] * leg_m) & (reach <= EXTENSION[1] * leg_m)
        com += _leg_moment(body, side, hip, ankles[side], trunk[:, :, 0])
    return np.asarray(com[accepted] / body.mass_kg)


def _turned(yaw_rad: Series, point: Vector3) -> Points:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.column_stack([c * point[0] - s * point[1], s * point[0] + c * point[1], np.full_like(c, point[2])])


def _upper_body_moment(body: AnthropometricBody, trunk: np.ndarray, hips: Points) -> Points:
    """Mass times centre of all links above the hips, rigid in the reference pose."""
    data, model = body.model.createData(), body.model
    q = np.zeros(model.nq)
    pin.forwardKinematics(model, data, q)
    legs = [body.joint[f"{side}_{link}"] for side in "lr" for link in ("thigh", "shank", "foot")]
    above = [k for k in range(1, model.njoints) if k not in legs]
    mass = sum(model.inertias[k].mass for k in above)
    moment = sum(model.inertias[k].mass * data.oMi[k].act(model.inertias[k].lever) for k in above)
    return np.asarray(mass * hips + trunk @ moment)


def _leg_moment(body: AnthropometricBody, side: str, hip: Points, ankle: Points, ahead: Points) -> Points:
    """Mass times centre of thigh, shank and foot, the knee bent in the plane of leg and forward axis."""
    p, inertias = body.proportions, body.model.inertias
    down = ankle - hip
    reach = np.linalg.norm(down, axis=1, keepdims=True)
    along = down / reach
    forward = ahead - (ahead * along).sum(axis=1, keepdims=True) * along
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    down_m = (p.thigh_m**2 - p.shank_m**2 + reach**2) / (2.0 * reach)
    knee = hip + down_m * along + np.sqrt(np.clip(p.thigh_m**2 - down_m**2, 0.0, None)) * forward
    moment = np.zeros_like(hip)
    for link, start, end, length in (("thigh", hip, knee, p.thigh_m), ("shank", knee, ankle, p.shank_m)):
        inertia = inertias[body.joint[f"{side}_{link}"]]
        moment += inertia.mass * (start - inertia.lever[2] / length * (end - start))
    foot = inertias[body.joint[f"{side}_foot"]]
    return np.asarray(moment + foot.mass * (ankle + foot.lever))
