"""A walk with exact contacts, made of formulas: feet that stand, swing and land at known instants, plates under some.

The vertical force is body weight at all times (a walker on wheels); what matters here is where it is measured.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stridelab.recordings.recording import Plate, Recording, Subject

STEP_M, STEP_S, STANCE_S = 0.6, 0.5, 0.6
"""Step length and time of one foot after the other; each foot stands for 0.6 s of every 1.0 s."""
WEIGHT_N = 700.0
LANDMARKS = {f"{side}_{name}": f"{side}_{name}" for side in "lr" for name in ("heel", "mt1", "mt5")}
FOOT = {"heel": (0.0, 0.0, 0.03), "mt1": (0.18, 0.04, 0.03), "mt5": (0.15, -0.04, 0.03)}


@dataclass(frozen=True)
class Contact:
    """One stance: from ``start_s`` to ``end_s`` with the heel at ``heel_m``."""

    side: str
    start_s: float
    end_s: float
    heel_m: np.ndarray


def contacts(n_steps: int) -> list[Contact]:
    """Stance k of alternating feet: it starts at k times 0.5 s - 0.3 s, 0.6 m further each time."""
    found = []
    for k in range(n_steps):
        side = "lr"[k % 2]
        y = 0.1 if side == "l" else -0.1
        found.append(Contact(side, STEP_S * k - 0.3, STEP_S * k - 0.3 + STANCE_S, np.array([STEP_M * k, y, 0.0])))
    return found


def foot_position(stances: list[Contact], time_s: np.ndarray) -> np.ndarray:
    """Heel of one foot: still while it stands, at constant speed on an arc between stances."""
    x = np.zeros((len(time_s), 3))
    for a, b in itertools.pairwise(stances):
        swing = (time_s >= a.end_s) & (time_s < b.start_s)
        share = (time_s[swing] - a.end_s) / (b.start_s - a.end_s)
        rise = np.outer(np.sin(np.pi * share), [0.0, 0.0, 0.12])
        x[swing] = a.heel_m + share[:, None] * (b.heel_m - a.heel_m) + rise
    for stance in stances:
        x[(time_s >= stance.start_s) & (time_s < stance.end_s)] = stance.heel_m
    return x


def corners(centre_m: Sequence[float], size_m: tuple[float, float] = (0.58, 0.5)) -> np.ndarray:
    x, y, z = centre_m
    a, b = size_m[0] / 2, size_m[1] / 2
    return np.array([[x - a, y + b, z], [x + a, y + b, z], [x + a, y - b, z], [x - a, y - b, z]])


def walk(
    plates_under: Sequence[int], *, n_steps: int = 7, rate_hz: float = 100.0, force_rate_hz: float = 1000.0
) -> Recording:
    """A walk of ``n_steps`` stances with a plate under each stance whose number is in ``plates_under``."""
    duration_s = STEP_S * (n_steps - 1)
    time_s = np.arange(round(duration_s * rate_hz)) / rate_hz
    force_time_s = np.arange(round(duration_s * force_rate_hz)) / force_rate_hz
    stances = contacts(n_steps + 2)
    markers = {}
    for side in "lr":
        heel = foot_position([c for c in stances if c.side == side], time_s)
        for name, offset in FOOT.items():
            markers[f"{side}_{name}"] = heel + offset
    pelvis = np.column_stack([STEP_M / STEP_S * time_s, 0 * time_s, 0.95 + 0 * time_s])
    markers |= {f"pelvis_{k}": pelvis + np.array([0.0, 0.1 * k - 0.2, 0.02 * k]) for k in range(5)}
    plates = []
    for index, k in enumerate(plates_under, start=1):
        c = stances[k]
        force = np.zeros((len(force_time_s), 3))
        force[:, 2] = WEIGHT_N * share_of_weight(c, stances, force_time_s)
        cop = c.heel_m + np.array([0.09, 0.0, 0.0])
        plates.append(
            Plate(index, 2, corners(c.heel_m * [1, 0, 1] + [0.09, 0, 0]), force, np.cross(cop, force), np.zeros(3))
        )
    return Recording(markers, rate_hz, force_rate_hz, tuple(plates), Subject(), (), "+z", np.array([1.0, 0.0, 0.0]))


def share_of_weight(contact: Contact, stances: list[Contact], time_s: np.ndarray) -> np.ndarray:
    """1 in single support, shared linearly in double support; all shares add to 1."""
    double_s = STANCE_S - STEP_S
    rise = np.clip((time_s - contact.start_s) / double_s, 0.0, 1.0)
    fall = np.clip((contact.end_s - time_s) / double_s, 0.0, 1.0)
    return np.minimum(rise, fall)
