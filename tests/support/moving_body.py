"""A body whose vertical motion and force are known exactly: a sit-to-stand, a drop jump, a stand, on one plate."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Points, Series
from stridelab.recordings.recording import Plate, Recording, Subject
from support.schematic_walk import FOOT, corners

MASS_KG = 64.0
RATE_HZ, FORCE_RATE_HZ = 100.0, 1000.0


@dataclass(frozen=True)
class MovingBody:
    """The recording, its centre of mass (frames x 3), and the share of body weight that something else carries."""

    recording: Recording
    com_m: Points
    beside: Series


def moving_body(
    height_m: Callable[[Series], Series], beside: Callable[[Series], Series], duration_s: float
) -> MovingBody:
    """Both feet rest on one plate, and the centre of mass is at ``height_m`` of the time.

    The plate measures m (g + z'') less the share ``beside`` of the body weight that a chair or a box carries.
    """
    force_s = np.arange(round(duration_s * FORCE_RATE_HZ)) / FORCE_RATE_HZ
    time_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    lift = np.gradient(np.gradient(height_m(force_s))) * FORCE_RATE_HZ**2
    force = np.zeros((len(force_s), 3))
    force[:, 2] = np.maximum(MASS_KG * (GRAVITY_M_S2 * (1.0 - beside(force_s)) + lift), 0.0)
    markers = {
        f"{side}_{name}": np.tile(np.add(offset, [0.0, y, 0.0]), (len(time_s), 1))
        for side, y in (("l", 0.1), ("r", -0.1))
        for name, offset in FOOT.items()
    }
    com = np.column_stack([0.05 + 0 * time_s, 0 * time_s, height_m(time_s)])
    markers |= {"pelvis": com.copy()}
    plate = Plate(1, 2, corners((0.1, 0.0, 0.0), (0.6, 0.6)), force, np.cross([0.05, 0.0, 0.0], force), np.zeros(3))
    recording = Recording(markers, RATE_HZ, FORCE_RATE_HZ, (plate,), Subject(), (), "+z", None)
    return MovingBody(recording, com, beside(time_s))


def smooth(time_s: Series, start_s: float, end_s: float) -> Series:
    """From 0 to 1 with no velocity and no acceleration at either end."""
    x = np.clip((time_s - start_s) / (end_s - start_s), 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x**2))


def sit_to_stand() -> MovingBody:
    """Sits until 1.5 s (nine tenths on a chair beside the plate), has left the chair at 1.9 s, stands from 2.8 s on."""
    return moving_body(
        lambda t: 0.62 + 0.35 * smooth(t, 1.4, 2.8), lambda t: 0.9 * (1.0 - smooth(t, 1.5, 1.9)), duration_s=4.5
    )


def stand() -> MovingBody:
    """Stands still, with a sway of 1 mm."""
    return moving_body(lambda t: 0.95 + 0.001 * np.sin(2.0 * t), np.zeros_like, duration_s=3.0)


DROP_S, LANDED_S, STOOD_S = 0.6, 0.9, 1.5
"""The jumper leaves a box, reaches the plate, and has come to rest."""


def drop_jump() -> MovingBody:
    """Stands on a box until 0.6 s, falls for 0.3 s beside nothing, and is stopped within 0.6 s on the plate."""
    speed_m_s = GRAVITY_M_S2 * (LANDED_S - DROP_S)

    def height_m(t: Series) -> Series:
        fallen = 0.5 * GRAVITY_M_S2 * np.clip(t - DROP_S, 0.0, LANDED_S - DROP_S) ** 2
        x = np.clip((t - LANDED_S) / (STOOD_S - LANDED_S), 0.0, 1.0)
        braked = speed_m_s * (STOOD_S - LANDED_S) * (x - x**3 + 0.5 * x**4)
        return np.asarray(1.6 - fallen - braked)

    body = moving_body(height_m, lambda t: (t < DROP_S).astype(float), duration_s=3.0)
    on_box = body.recording.time_s < DROP_S
    falling = np.clip(body.recording.time_s - DROP_S, 0.0, LANDED_S - DROP_S)
    above_m = 0.5 * GRAVITY_M_S2 * ((LANDED_S - DROP_S) ** 2 - falling**2)
    markers = {
        label: track
        if label == "pelvis"
        else track + np.outer(above_m, [0.0, 0.0, 1.0]) - np.outer(on_box, [0.8, 0, 0])
        for label, track in body.recording.markers_m.items()
    }
    return replace(body, recording=replace(body.recording, markers_m=markers))
