"""Recorded walks for the items on real recordings: geometric CoM, plate forces, body mass."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, TypeVar
from zipfile import ZipFile

import numpy as np

from stridelab.body.geometric_com import GeometricCom
from stridelab.body.segment_model import SegmentModel
from stridelab.conventions import GRAVITY_M_S2
from stridelab.dynamics.wrench import AXIS_THRESHOLD_N
from stridelab.errors import NotFound, StridelabError
from stridelab.recordings.foot_contact import is_treadmill
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording, Window, WrenchTrack

STATICS: Final = ("*_ST.c3d", "Static*.c3d", "Static/*.c3d", "static.trc")
FORCES_SUFFIX: Final = "_grf.mot"
"""End of the name of a TRC file's forces, in place of ``.trc``."""
MIN_FLIGHTS: Final = 5
Walk = TypeVar("Walk")


@dataclass(frozen=True, eq=False)
class RecordedWalk:
    """One recording of a subject named after its folder; in ``windows`` all contact is on plates."""

    person: str
    recording: Recording
    mass_kg: float
    geometric: GeometricCom
    windows: tuple[Window, ...]

    @staticmethod
    def from_file(path: Path, folder: Path | None = None) -> "RecordedWalk":
        """Read a recording, with joint centres from the static trial in ``folder`` or below: the person's.

        By default it is the folder of the recording.

        Raises ``NotFound`` (``recordings-missing``) if the body mass is missing, and the errors of the readers.
        """
        recording = read_trial(path)
        windows = measured_windows(recording, identify(list(recording.markers_m)).landmarks)
        mass_kg = recording.subject.mass_kg
        if mass_kg is None and is_treadmill(recording):
            mass_kg = mass_of_runner_kg(wrench_track(recording, windows))
        if mass_kg is None:
            raise NotFound("recordings-missing", f"{path.name} does not contain the body mass of the subject.")
        folder = folder or path.parent
        return RecordedWalk(folder.name, recording, mass_kg, geometric_com_of(recording, folder), windows)

    def total_wrench(self, latency_s: float) -> WrenchTrack:
        """Total contact wrench, corrected for the latency: read ``latency_s`` later than its time stamp."""
        track = wrench_track(self.recording, self.windows, latency_s=latency_s)
        return replace(track, clocks_compared=True)


def read_trial(path: Path) -> Recording:
    """Read a recording; a TRC file with the forces of the same name beside it. Raises as ``read_recording``."""
    forces = path.with_name(path.stem + FORCES_SUFFIX)
    if path.suffix != ".trc" or not forces.exists():
        return read_recording(path)
    with TemporaryDirectory() as folder:
        both = Path(folder) / f"{path.stem}.zip"
        with ZipFile(both, "w") as archive:
            archive.write(path, path.name)
            archive.write(forces, forces.name)
        return read_recording(both, name=path.name)


@dataclass(frozen=True)
class LeftOut:
    """A recording that an item on people leaves out: folder and file, and the message of the error."""

    file: str
    reason: str


def read_each(paths: Iterable[Path], read: Callable[[Path], Walk]) -> tuple[list[Walk], list[LeftOut]]:
    """Results of ``read`` for all recordings that allow one, and the others, with the message of their error."""
    walks, left_out = list[Walk](), list[LeftOut]()
    for path in paths:
        try:
            walks.append(read(path))
        except StridelabError as error:
            left_out.append(LeftOut(f"{path.parent.name}/{path.name}", error.message))
    return walks, left_out


def read_some(gait: Path, pattern: str, read: Callable[[Path], Walk]) -> tuple[list[Walk], list[LeftOut]]:
    """``read_each`` of the recordings that match ``pattern``.

    Raises ``NotFound`` (``recordings-missing``) if there are none, or none allows a result.
    """
    walks, left_out = read_each(recordings_in(gait, pattern), read)
    if not walks:
        raise NotFound("recordings-missing", f"No recording {pattern} can be used.{left_out_text(left_out)}")
    return walks, left_out


def left_out_text(left_out: Sequence[LeftOut]) -> str:
    """The recordings that were left out and why, as a sentence that follows another one; empty without any."""
    reasons = (f"{each.file} ({each.reason.rstrip('.')})" for each in left_out)
    return f" Left out: {', '.join(reasons)}." if left_out else ""


def mass_of_runner_kg(wrench: WrenchTrack) -> float | None:
    """Mean vertical force over g, from the first to the last end of a flight; None with fewer than five flights.

    Over whole steps of a steady run the mean acceleration is zero.
    """
    up_n = wrench.force_n[:, 2]
    aloft = wrench.complete & (np.linalg.norm(wrench.force_n, axis=1) < AXIS_THRESHOLD_N)
    lands = np.flatnonzero(aloft[:-1] & ~aloft[1:])
    if len(lands) < MIN_FLIGHTS:
        return None
    during = slice(lands[0], lands[-1])
    return float(up_n[during].mean() / GRAVITY_M_S2) if wrench.complete[during].all() else None


def recordings_in(gait: Path, pattern: str) -> list[Path]:
    """Sorted recordings that match ``pattern``. Raises ``NotFound`` (``recordings-missing``) if there are none."""
    paths = sorted(gait.glob(pattern))
    if not paths:
        raise NotFound("recordings-missing", f"There is no recording {pattern} in the folder {gait.name}.")
    return paths


def geometric_com_of(recording: Recording, folder: Path) -> GeometricCom:
    """Geometric CoM from markers and segment table; uses the static trial of the folder if there is one."""
    landmarks = identify(list(recording.markers_m)).landmarks
    statics = sorted(path for pattern in STATICS for path in folder.rglob(pattern))
    static = read_recording(statics[0]) if statics else None
    return SegmentModel().com(recording, landmarks, subject=recording.subject, static=static)
