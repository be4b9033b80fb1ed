"""Raw content of a recording file: points and plate signals in the file's own axes, in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Corners, Points, Vector3
from stridelab.recordings.recording import Event, Remark, SegmentMotion, Subject

Cloud = Float[np.ndarray, "frames labels 3"]
"""Positions of all labels at all frames."""
Channels = Float[np.ndarray, "n channels"]
"""Samples of the analog channels of a plate."""
Ranges = Float[np.ndarray, "channels 2"]
"""Smallest and largest value of each channel."""

LARGEST_PLAUSIBLE = 1e9
"""Largest plausible magnitude in any unit; larger numbers come from damaged files and would overflow later."""

NO_FORCE_FILE = "no-force-file"
"""Code of the remark that a TRC file came without a force file."""

CONTACT_TYPE = 0
"""``Plate.type`` of a measured contact without a known plate (OpenSim MOT): its corners bound the loaded COP."""


@dataclass(frozen=True)
class PlateSignals:
    """Signals of one plate in its own axes (x, y along the corners, z = x cross y).

    ``moment_nm`` is about the sensor; ``origin_m`` is the vector from the sensor to the centre of the surface;
    ``zero_samples`` are the first and last analog sample (from 1) to average, as in FORCE_PLATFORM:ZERO.
    ``moment_unit`` is the unit text by which the moments were scaled, None if the unit is fixed (types 1 and 3).
    ``channels`` are the samples of the channels that a load may drive to their limits, in the file's units;
    ``ranges`` the values of each between which the file's converter works, NaN where it does not state them.
    """

    index: int
    type: int
    corners_m: Corners
    origin_m: Vector3
    force_n: Points
    moment_nm: Points
    zero_samples: tuple[int, int] | None
    moment_unit: str | None = None
    channels: Channels = field(default_factory=lambda: np.zeros((0, 0)))
    ranges: Ranges = field(default_factory=lambda: np.zeros((0, 2)))


@dataclass(frozen=True)
class FilePlate:
    """One plate in the file's axes: wrench on the body about the file's origin, tare removed.

    ``usable`` is False if the loaded centre of pressure is never on the plate; its wrench is then excluded from sums.
    ``clipped_s`` are the times at which a channel stays at its limit.
    """

    index: int
    type: int
    corners_m: Corners
    force_n: Points
    moment_nm: Points
    tare_force_n: Vector3
    usable: bool = True
    tare_moment_nm: Vector3 = field(default_factory=lambda: np.zeros(3))
    zero_is_known: bool = False
    clipped_s: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class RawTrial:
    """Content of one file (or pair of files) in the file's axes.

    ``labels`` are unique and cleaned; ``outputs`` are those of positions computed by a model. ``plates`` holds raw
    signals of C3D plates, ``contacts`` the contacts of a MOT file. ``up_hint`` is the vertical axis according to the
    file, if given; ``up_is_known`` if it was measured and is no convention of the format. ``metres_per_unit`` is the
    factor by which its lengths were multiplied. ``recorded_on`` is the day of the recording as YYYY-MM-DD, empty if the
    file does not contain it. ``segments`` are those of its body model.
    """

    labels: tuple[str, ...]
    outputs: frozenset[str]
    points_m: Cloud
    marker_rate_hz: float
    force_rate_hz: float
    plates: tuple[PlateSignals, ...]
    contacts: tuple[FilePlate, ...]
    subject: Subject
    events: tuple[Event, ...]
    up_hint: str | None
    remarks: tuple[Remark, ...]
    metres_per_unit: float
    joint_widths_m: Mapping[str, float] = field(default_factory=dict)
    carried: Mapping[str, str] = field(default_factory=dict)
    recorded_on: str = ""
    segments: Mapping[str, SegmentMotion] = field(default_factory=dict)
    up_is_known: bool = False
