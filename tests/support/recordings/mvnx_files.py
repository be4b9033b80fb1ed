"""Small MVNX files of a body that walks in closed form, with the points and the centre of mass of Xsens MVN."""

import numpy as np
from jaxtyping import Float

RATE_HZ = 60.0
SPEED_M_S = 1.1
_PAIRED = {
    "UpperLeg": (0.0, 0.1, 0.9),
    "LowerLeg": (0.0, 0.1, 0.5),
    "Foot": (0.0, 0.1, 0.1),
    "Toe": (0.15, 0.1, 0.02),
    "UpperArm": (0.0, 0.2, 1.4),
    "ForeArm": (0.0, 0.2, 1.1),
    "Hand": (0.0, 0.2, 0.85),
}
SEGMENTS = {"Pelvis": (0.0, 0.0, 0.95), "T8": (0.0, 0.0, 1.3), "Neck": (0.0, 0.0, 1.5)}
SEGMENTS |= {f"Left{name}": place for name, place in _PAIRED.items()}
SEGMENTS |= {f"Right{name}": (x, -y, z) for name, (x, y, z) in _PAIRED.items()}
COM_M = np.array([0.01, 0.0, 0.98])
POINT_M = np.array([0.08, 0.02, -0.03])
"""Place of the one point of each segment in its frame."""


def yaw_rad(frame: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return np.asarray(0.3 * np.sin(0.1 * frame))


def mvnx_text(*, n_frames: int = 60, points: bool = True, com: bool = True, listed: bool = True, head: str = "") -> str:
    """A file with two calibration poses before the motion; every segment turns by ``yaw_rad`` about the vertical."""
    segments = ""
    if listed:
        point = f"<points><point label='p{{}}'><pos_b>{_text(POINT_M)}</pos_b></point></points>" if points else ""
        segments = "".join(f"<segment label='{s}' id='{k}'>{point.format(s)}</segment>" for k, s in enumerate(SEGMENTS))
        segments = f"<segments>{segments}</segments>"
    frames = "".join(f"<frame type='{pose}'><position>0 0 0</position></frame>" for pose in ("identity", "tpose"))
    for k in range(n_frames):
        shift = np.array([SPEED_M_S * k / RATE_HZ, 0.0, 0.0])
        half = 0.5 * float(yaw_rad(np.array([k]))[0])
        turn = f"{np.cos(half):.9f} 0 0 {np.sin(half):.9f} " * len(SEGMENTS)
        place = " ".join(_text(np.array(one) + shift) for one in SEGMENTS.values())
        centre = f"<centerOfMass>{_text(COM_M + shift)} 1.1 0 0 0 0 0</centerOfMass>" if com else ""
        frames += (
            f"<frame time='{k}' type='normal'><orientation>{turn}</orientation><position>{place}</position>"
            f"<velocity>not read</velocity>{centre}</frame>"
        )
    return (
        f"<?xml version='1.0' encoding='UTF-8'?>\n{head}<mvnx version='4'><mvn version='2021'/>"
        f"<subject label='Anna' frameRate='{RATE_HZ:g}' segmentCount='{len(SEGMENTS)}' "
        f"recDate='Thu Nov 27 12:13:17.238 2025'>{segments}<frames>{frames}</frames></subject></mvnx>\n"
    )


def _text(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.9f}" for number in numbers)
