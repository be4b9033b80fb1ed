"""Windows: the intervals in which *all* contact force is measured.

A frame is complete when every foot that may be on the ground stands on plates in use that are loaded. On overground
walks over two plates this is from the trailing foot's lift-off to the leading foot's second strike; outside, the plates
measure less than the whole force and nothing in their signals tells. The events in a file are not used.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from stridelab.conventions import Mask, Points, Rotation
from stridelab.errors import Fault, NotEstimable
from stridelab.recordings.feet import Foot, find_feet
from stridelab.recordings.gaps import runs
from stridelab.recordings.plates import plate_axes
from stridelab.recordings.raw import CONTACT_TYPE
from stridelab.recordings.recording import Plate, Recording, Remark, Window
from stridelab.recordings.steps import loaded_intervals, whole_steps

MIN_WINDOW_S = 0.25
_EDGE_M = 0.03
"""A marker sits on the skin: it may lie this far outside a plate on which the foot stands."""
_BELOW_M, _ABOVE_M = 0.06, 0.30
"""Range of marker heights over the plate's surface for a foot on it."""
_OVERHANG_M = 0.12
_STAIR_M = 0.05
_COP_REACH_M = 0.15
_SLACK_S = 0.1
"""Landing and lifting are seen in markers and in load at slightly different instants."""


@dataclass(frozen=True)
class WindowSearch:
    """The windows, longest first where they tie in nothing else, and what limits trust in them."""

    windows: tuple[Window, ...]
    remarks: tuple[Remark, ...]


def measured_windows(recording: Recording, landmarks: Mapping[str, str]) -> tuple[Window, ...]:
    """Windows in order of time; ``landmarks`` maps landmark names to labels."""
    return find_windows(recording, landmarks).windows


def find_windows(recording: Recording, landmarks: Mapping[str, str]) -> WindowSearch:
    """Windows with remarks: windows-from-load, one-step-window, no-whole-step, two-feet-on-one-plate."""
    plates = [plate for plate in recording.plates if plate.use]
    if not plates or recording.n_frames < 2:
        return WindowSearch((), ())
    feet = find_feet(recording, landmarks)
    if not feet:
        remark = Remark(
            "windows-from-load",
            "The feet are not marked, so it is not known when one of them stood beside the plates; the measured "
            "interval was estimated from the load on the plates and a symmetric walk.",
        )
        return WindowSearch(_from_load(recording, plates), (remark,))
    heights = [float(plate.corners_m[:, 2].mean()) for plate in plates]
    stairs = max(heights) - min(heights) > _STAIR_M
    loaded = [_loaded_at_frames(recording, plate) for plate in plates]
    complete = np.ones(recording.n_frames, dtype=bool)
    standing = []
    for foot in feet:
        on_plate = np.stack([_on_plate(recording, p, mask, foot) for p, mask in zip(plates, loaded, strict=True)])
        somewhere = on_plate.any(axis=0)
        beside = (foot.resting & ~somewhere).any(axis=1)
        if stairs:
            beside &= ~_overhangs(recording, plates, foot)
        complete &= ~beside & (~foot.unseen | somewhere.any(axis=1))
        standing.append(_main_plate(plates, on_plate & foot.resting, foot))
    shared = (standing[0] == standing[1]) & (standing[0] >= 0)
    windows = tuple(
        window for window in _as_windows(complete, recording.marker_rate_hz) if _carries(recording, plates, window)
    )
    remarks = _trust(recording, windows)
    if shared.sum() >= _SLACK_S * recording.marker_rate_hz and _alternates(feet):
        message = "Two feet stand on one plate at a time: the total force is right, the force per foot is not."
        remarks = (*remarks, Remark("two-feet-on-one-plate", message))
    return WindowSearch(windows, remarks)


def _trust(recording: Recording, windows: tuple[Window, ...]) -> tuple[Remark, ...]:
    """What to say of a walk whose windows hold less than a step from strike to strike and one from lift to lift."""
    if not windows or recording.walking_direction is None:
        return ()
    spans = max(len(whole_steps(recording, window)) for window in windows)
    if spans >= 2:
        return ()
    held = "one whole step" if spans else "no whole step"
    message = f"The interval in which all force is measured holds {held}; position offsets seen in it are uncertain."
    return (Remark("one-step-window" if spans else "no-whole-step", message),)


def require_windows(recording: Recording, landmarks: Mapping[str, str]) -> tuple[Window, ...]:
    """The windows, or ``NotEstimable`` with the reason why there is none.

    Codes: single-frame, no-plates, plates-switched-off, plates-unloaded, no-measured-window.
    """
    if recording.n_frames < 2:
        raise NotEstimable("single-frame", "The recording has one frame only: it can serve as a static trial.")
    if not recording.plates:
        raise NotEstimable("no-plates", "The recording has no force plate, so no force can be fused with the markers.")
    used = [plate for plate in recording.plates if plate.use]
    if not used:
        raise NotEstimable("plates-switched-off", "All force plates of this recording are switched off.")
    if not any(loaded_intervals(plate, recording.force_rate_hz) for plate in used):
        faults = [Fault(f"plate {plate.index}", f"never above {plate.threshold_n:g} N") for plate in used]
        raise NotEstimable("plates-unloaded", "Nobody stands on the force plates in this recording.", faults)
    windows = measured_windows(recording, landmarks)
    if not windows:
        raise NotEstimable(
            "no-measured-window",
            "At no time is all contact force measured: whenever a plate is loaded, a foot stands beside the plates.",
        )
    return windows


def _loaded_at_frames(recording: Recording, plate: Plate) -> Mask:
    """Frames at which the plate is loaded, widened by the slack on both sides."""
    loaded = np.zeros(recording.n_frames, dtype=bool)
    time_s = recording.time_s
    for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz):
        loaded |= (time_s >= start_s - _SLACK_S) & (time_s <= end_s + _SLACK_S)
    return loaded


def _on_plate(recording: Recording, plate: Plate, loaded: Mask, foot: Foot) -> Bool[np.ndarray, "n markers"]:
    """Per frame and marker of the foot: above the surface of this plate, which works (it is loaded at some time).

    A contact without a plate has no surface; there the foot must be at its centre of pressure while it is loaded.
    """
    if not loaded.any():
        return np.zeros(foot.markers_m.shape[:2], dtype=bool)
    if plate.type == CONTACT_TYPE:
        near = _near_cop(recording, plate, foot)
        return np.repeat((near & loaded)[:, None], foot.markers_m.shape[1], axis=1)
    return _over(plate, foot.markers_m, _EDGE_M)


def _main_plate(plates: list[Plate], under: Bool[np.ndarray, "plates n markers"], foot: Foot) -> Int[np.ndarray, "n"]:
    """Index of the plate under most of the foot's resting markers, of several the nearest in height; -1 for none."""
    heights = np.array([plate.corners_m[:, 2].mean() for plate in plates])
    lowest = np.nan_to_num(np.nanmin(np.nan_to_num(foot.markers_m[..., 2], nan=np.inf), axis=1), posinf=0.0)
    score = under.sum(axis=2) - np.clip(np.abs(lowest - heights[:, None]), 0.0, 0.9)
    best = np.argmax(np.where(under.any(axis=2), score, -1.0), axis=0)
    return np.asarray(np.where(under.any(axis=(0, 2)), best, -1))


def _overhangs(recording: Recording, plates: list[Plate], foot: Foot) -> Mask:
    """On stairs the end of a foot may stick out over the edge of its plate: nothing is under it at that height."""
    held = np.zeros(recording.n_frames, dtype=bool)
    for plate in plates:
        over, near = _over(plate, foot.markers_m, _EDGE_M), _over(plate, foot.markers_m, _OVERHANG_M)
        held |= (over & foot.resting).any(axis=1) & (near | ~foot.resting).all(axis=1)
    return held


def _over(plate: Plate, points_m: Float[np.ndarray, "n markers 3"], edge_m: float) -> Bool[np.ndarray, "n markers"]:
    """Whether points are above the plate widened by ``edge_m`` on all sides, at the height of a foot's markers."""
    R: Rotation = plate_axes(plate.corners_m)
    local = (points_m - plate.corners_m.mean(axis=0)) @ R
    half_x = 0.5 * np.linalg.norm(plate.corners_m[0] - plate.corners_m[1]) + edge_m
    half_y = 0.5 * np.linalg.norm(plate.corners_m[0] - plate.corners_m[3]) + edge_m
    above = local[..., 2] * np.sign(R[2, 2])
    inside = (np.abs(local[..., 0]) <= half_x) & (np.abs(local[..., 1]) <= half_y)
    return np.asarray(inside & (above > -_BELOW_M) & (above < _ABOVE_M))


def _near_cop(recording: Recording, plate: Plate, foot: Foot) -> Mask:
    """Whether the foot, as the line from its first to the middle of its other markers, is within 15 cm of the COP."""
    cop = _cop_at_frames(recording, plate)
    heel, fore = foot.markers_m[:, 0, :2], np.nanmean(foot.markers_m[:, 1:, :2], axis=1)
    along = fore - heel
    share = np.clip(((cop - heel) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.2)
    return np.asarray(np.linalg.norm(heel + share[:, None] * along - cop, axis=1) < _COP_REACH_M)


def _cop_at_frames(recording: Recording, plate: Plate) -> np.ndarray:
    """Centre of pressure on the contact's own height at the frames; the nearest loaded one while unloaded."""
    f, nu = plate.force_n, plate.moment_nm
    loaded = plate.loaded & (np.abs(f[:, 2]) > plate.threshold_n)
    if not loaded.any():
        return np.full((recording.n_frames, 2), np.nan)
    z = float(plate.corners_m[:, 2].mean())
    x = (f[loaded, 0] * z - nu[loaded, 1]) / f[loaded, 2]
    y = (f[loaded, 1] * z + nu[loaded, 0]) / f[loaded, 2]
    at_s = np.flatnonzero(loaded) / recording.force_rate_hz
    nearest = (
        np.clip(np.searchsorted(at_s, recording.time_s), 1, len(at_s) - 1) if len(at_s) > 1 else np.zeros(0, dtype=int)
    )
    if len(at_s) == 1:
        nearest = np.zeros(recording.n_frames, dtype=int)
    else:
        nearest -= recording.time_s - at_s[nearest - 1] < at_s[nearest] - recording.time_s
    return np.column_stack([x[nearest], y[nearest]])


def _as_windows(complete: Mask, rate_hz: float) -> list[Window]:
    """Runs of complete frames that are long enough; a hole of one frame does not end a window."""
    bridged = complete.copy()
    for i, j in runs(~complete):
        if j - i == 1 and i > 0 and j < len(complete):
            bridged[i:j] = True
    windows = [Window(i / rate_hz, (j - 1) / rate_hz) for i, j in runs(bridged)]
    return [window for window in windows if window.duration_s >= MIN_WINDOW_S]


def _carries(recording: Recording, plates: list[Plate], window: Window) -> bool:
    """Whether somebody stands on the plates in half of the window at least."""
    total_n = np.sum([plate.force_n[:, 2] for plate in plates], axis=0)
    i, j = int(window.start_s * recording.force_rate_hz), int(window.end_s * recording.force_rate_hz) + 1
    return float(np.mean(total_n[i:j] > 2.0 * plates[0].threshold_n)) > 0.5


def _alternates(feet: tuple[Foot, ...]) -> bool:
    """Whether this is a walk (each foot lifts at some time), not standing."""
    return all(not foot.contact.all() for foot in feet)


def _from_load(recording: Recording, plates: list[Plate]) -> tuple[Window, ...]:
    """From two overlapping contacts A, B of a symmetric walk.

    The double support A-B lasts d = end(A) - start(B). The foot before A lifts d after A's start, the foot after B
    strikes d before B's end, so all force is measured in [start(A) + d, end(B) - d]; a tenth of d is given away.
    """
    contacts = sorted(interval for plate in plates for interval in loaded_intervals(plate, recording.force_rate_hz))
    if not contacts:
        return ()
    if len(contacts) == 1 and contacts[0][1] - contacts[0][0] > 0.98 * recording.duration_s:
        return (Window(contacts[0][0], min(contacts[0][1], recording.duration_s)),)
    found: list[tuple[float, float]] = []
    for (a0, a1), (b0, b1) in itertools.pairwise(contacts):
        d = 1.1 * (a1 - b0)
        if d <= 0.0 or b1 - d - (a0 + d) < MIN_WINDOW_S:
            continue
        start_s, end_s = a0 + d, b1 - d
        if found and start_s <= found[-1][1]:
            found[-1] = (found[-1][0], max(end_s, found[-1][1]))
        else:
            found.append((start_s, end_s))
    return tuple(Window(start_s, end_s) for start_s, end_s in found)


def centre_of_pressure_m(plate: Plate) -> Points:
    """Centre of pressure on the plate's own plane, NaN while the plate is unloaded."""
    c = plate.corners_m.mean(axis=0)
    normal = plate_axes(plate.corners_m)[:, 2]
    moment = plate.moment_nm - np.cross(c, plate.force_n)
    across = plate.force_n @ normal
    cop = np.full_like(plate.force_n, np.nan)
    on = plate.loaded & (np.abs(across) > 0.5 * plate.threshold_n)
    cop[on] = c + np.cross(normal, moment[on]) / across[on, None]
    return cop
