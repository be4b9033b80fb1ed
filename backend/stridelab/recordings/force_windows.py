"""Windows: the intervals in which *all* contact force is measured.

A frame is complete if the whole outline of every foot that may be on the ground lies on loaded plates in use. On
overground walks over two plates this holds from the trailing foot's lift-off to the leading foot's second strike. If
the motion of the body is known, frames in which the plates carry less than the motion requires are excluded as well: a
chair, a rail or the floor beside a plate carries the rest. So are frames in which a plate is overloaded. In flight
the contact force is known to be zero: these frames are complete, wherever the feet are, and count as measured. The
events in a file are not used.

Flight: no plate is loaded, both feet are above the floor, and z falls as a parabola of -g. The contact force is then
known to be zero, wherever the feet are.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from stridelab.conventions import GRAVITY_M_S2, Mask, Series
from stridelab.errors import Fault, NotEstimable
from stridelab.recordings.body_mass import VerticalMotion
from stridelab.recordings.clipped_force import FORCE_CLIPPED, clipped_frames
from stridelab.recordings.files.raw import NO_FORCE_FILE
from stridelab.recordings.foot_contact import Foot, find_feet, foot_outline
from stridelab.recordings.force_plates import COP_NEVER_ON_PLATE
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.missing_force import FORCE_MISSING, frames_missing_force
from stridelab.recordings.plate_contacts import (
    STAIR_M,
    loaded_intervals,
    main_plate,
    markers_on_plate,
    outline_off_plates,
    step_overhang_contacts,
    vertical_force_n,
    whole_steps,
)
from stridelab.recordings.recording import Plate, Recording, Remark, Window

MIN_WINDOW_S = 0.25
"""Half a step at a normal pace; nothing can be estimated from less."""
MIN_FRAMES = 6
"""Fewest frames from which velocity and acceleration follow: the quintic spline through them has six coefficients."""
_SHARED_S = 0.05
_MIN_CONTACT_S = 0.12
"""Shortest contact in a window: the stance of a sprint, with flight on both sides of it."""


@dataclass(frozen=True)
class WindowSearch:
    """The windows in order of time, and remarks about their reliability."""

    windows: tuple[Window, ...]
    remarks: tuple[Remark, ...]


def measured_windows(
    recording: Recording, landmarks: Mapping[str, str], motion: VerticalMotion | None = None
) -> tuple[Window, ...]:
    """Windows in order of time; ``landmarks`` maps landmarks to labels, ``motion`` is that of ``vertical_motion``."""
    return find_windows(recording, landmarks, motion).windows


def find_windows(
    recording: Recording,
    landmarks: Mapping[str, str],
    motion: VerticalMotion | None = None,
    *,
    stated_kg: float | None = None,
) -> WindowSearch:
    """Windows with remarks: windows-from-load, force-missing, one-step-window, no-whole-step, two-feet-on-one-plate.

    Without ``motion`` (``vertical_motion``) only the feet are checked. ``stated_kg`` is the mass given by the user or
    the file.
    """
    plates = [plate for plate in recording.plates if plate.use]
    if not plates or recording.n_frames < 2:
        return WindowSearch((), ())
    feet = find_feet(recording, landmarks)
    if not feet:
        remark = Remark(
            "windows-from-load",
            "The feet are not marked, so it is unknown when one of them stood beside the plates; the measured "
            "interval was estimated from the load on the plates and a symmetric walk.",
        )
        windows, missing = _remove_unknown_force(recording, _windows_from_load(recording, plates), motion, stated_kg)
        return WindowSearch(windows, (remark, *missing))
    complete, shared = _complete_frames(recording, landmarks, plates, feet)
    flight = flight_frames(recording, feet, motion)
    candidates = tuple(
        window
        for window in _as_windows(complete | flight, recording.marker_rate_hz)
        if _is_mostly_measured(recording, plates, window, flight)
    )
    windows, missing = _remove_unknown_force(recording, candidates, motion, stated_kg)
    remarks = (*missing, *_step_coverage_remarks(recording, windows))
    if np.count_nonzero(shared) >= _SHARED_S * recording.marker_rate_hz and _both_feet_lift(feet):
        message = "Two feet stand on one plate at a time: the total force is right, the force per foot is not."
        remarks = (*remarks, Remark("two-feet-on-one-plate", message))
    return WindowSearch(windows, remarks)


def _complete_frames(
    recording: Recording, landmarks: Mapping[str, str], plates: list[Plate], feet: tuple[Foot, ...]
) -> tuple[Mask, Mask]:
    """Masks of the frames without a foot beside the plates, and of the frames with both feet on one plate."""
    heights = [float(plate.corners_m[:, 2].mean()) for plate in plates]
    stairs = max(heights) - min(heights) > STAIR_M
    complete = np.ones(recording.n_frames, dtype=bool)
    standing: list[Int[np.ndarray, " n"]] = []
    for foot in feet:
        under = np.stack([markers_on_plate(recording, plate, foot) for plate in plates])
        somewhere = np.any(under, axis=0)
        beside = np.any(foot.resting & ~somewhere, axis=1)
        beside |= outline_off_plates(recording, plates, foot, foot_outline(recording, landmarks, foot))
        if stairs:
            beside &= ~step_overhang_contacts(plates, foot)
        complete &= ~beside & (~foot.unseen | np.any(somewhere, axis=1))
        standing.append(main_plate(under, foot))
    return complete, np.logical_and(standing[0] == standing[1], standing[0] >= 0)


def _remove_unknown_force(
    recording: Recording, windows: tuple[Window, ...], motion: VerticalMotion | None, stated_kg: float | None
) -> tuple[tuple[Window, ...], tuple[Remark, ...]]:
    """Remove the frames with clipped and with missing force from the windows; a remark lists the times of the latter.

    The recording itself has the remark on clipped force.
    """
    rate_hz = recording.marker_rate_hz
    clipped = clipped_frames(recording)
    if clipped.any():
        windows = _split_windows(windows, clipped, rate_hz)
    if motion is None or not windows:
        return windows, ()
    missing = frames_missing_force(recording, windows, motion, stated_kg)
    if not missing.any():
        return windows, ()
    when = ", ".join(f"{i / rate_hz:.2f} to {(j - 1) / rate_hz:.2f} s" for i, j in true_runs(missing))
    message = (
        f"The plates carry less than the motion of the body needs at {when}: something beside them carries the rest "
        "(a part of a foot, a chair, a rail), or the stated mass is too large. These times are not used."
    )
    return _split_windows(windows, missing, rate_hz), (Remark(FORCE_MISSING, message),)


def _split_windows(windows: tuple[Window, ...], excluded: Mask, rate_hz: float) -> tuple[Window, ...]:
    """The parts of the windows without the ``excluded`` frames, of at least ``MIN_WINDOW_S``."""
    parts: list[Window] = []
    for window in windows:
        i, j = round(window.start_s * rate_hz), round(window.end_s * rate_hz) + 1
        parts += [Window((i + a) / rate_hz, (i + b - 1) / rate_hz) for a, b in true_runs(~excluded[i:j])]
    return tuple(part for part in parts if part.duration_s >= MIN_WINDOW_S)


def _step_coverage_remarks(recording: Recording, windows: tuple[Window, ...]) -> tuple[Remark, ...]:
    """Remark if no window of a walk contains a step from strike to strike and one from lift-off to lift-off."""
    if not windows or recording.walking_direction is None:
        return ()
    spans = max(len(whole_steps(recording, window)) for window in windows)
    if spans >= 2:
        return ()
    held = "one whole step" if spans else "no whole step"
    message = f"The interval in which all force is measured holds {held}; position offsets seen in it are uncertain."
    return (Remark("one-step-window" if spans else "no-whole-step", message),)


def require_windows(
    recording: Recording,
    landmarks: Mapping[str, str],
    motion: VerticalMotion | None = None,
    *,
    stated_kg: float | None = None,
) -> tuple[Window, ...]:
    """The windows of ``find_windows``: at least one.

    Raises ``NotEstimable`` without a window; the code is the reason: ``single-frame``, ``no-plates``,
    ``recording-too-short``, ``cop-off-all-plates``, ``plates-switched-off``, ``plates-unloaded``,
    ``forces-and-markers-apart``, ``no-measured-window``.
    """
    if recording.n_frames < 2:
        raise NotEstimable("single-frame", "The recording has only one frame: it can serve as a static trial.")
    if not recording.plates:
        message = (
            "The recording has no force plate, so no force can be fused with the markers. "
            "The method geometry gives the centre of mass from the markers alone."
        )
        faults = [Fault("forces", remark.message) for remark in recording.remarks if remark.code == NO_FORCE_FILE]
        raise NotEstimable("no-plates", message, faults)
    require_frames(recording.n_frames)
    if recording.duration_s < MIN_WINDOW_S:
        message = f"The recording lasts {1000.0 * recording.duration_s:.0f} ms; at least {MIN_WINDOW_S:g} s are needed."
        raise NotEstimable("recording-too-short", message)
    used = [plate for plate in recording.plates if plate.use]
    off = [remark for remark in recording.remarks if remark.code == COP_NEVER_ON_PLATE]
    if not used and off:
        message = (
            "No force plate of this recording can be used: under no unit does a centre of pressure lie on its plate. "
            "The method geometry gives the centre of mass from the markers alone."
        )
        raise NotEstimable("cop-off-all-plates", message, [Fault("plates", remark.message) for remark in off])
    if not used:
        raise NotEstimable("plates-switched-off", "All force plates of this recording are switched off.")
    if not any(loaded_intervals(plate, recording.force_rate_hz) for plate in used):
        faults = [Fault(f"plate {plate.index}", f"never above {plate.threshold_n:g} N") for plate in used]
        raise NotEstimable("plates-unloaded", "The force plates of this recording are never loaded.", faults)
    _require_overlap(recording, used)
    search = find_windows(recording, landmarks, motion, stated_kg=stated_kg)
    if not search.windows:
        why = ["Whenever a plate is loaded, a foot, or a part of one, stands beside the plates."]
        remarks = (*recording.remarks, *search.remarks)
        why = [remark.message for remark in remarks if remark.code in (FORCE_CLIPPED, FORCE_MISSING)] or why
        raise NotEstimable("no-measured-window", f"At no time is all contact force measured. {' '.join(why)}")
    return search.windows


def require_frames(n_frames: int) -> None:
    """Raise ``NotEstimable`` (``recording-too-short``) if so few frames cannot be differentiated."""
    if n_frames < MIN_FRAMES:
        message = f"The recording has {n_frames} frames in a row; at least {MIN_FRAMES} are needed for the velocity."
        raise NotEstimable("recording-too-short", f"{message} It can serve as a static trial.")


def _require_overlap(recording: Recording, used: list[Plate]) -> None:
    """Raise unless some marker is seen while some plate is loaded."""
    seen = np.any([np.isfinite(track).all(axis=1) for track in recording.markers_m.values()], axis=0)
    contacts = sorted(interval for plate in used for interval in loaded_intervals(plate, recording.force_rate_hz))
    time_s = recording.time_s
    if any(seen[(time_s >= start_s) & (time_s <= end_s)].any() for start_s, end_s in contacts):
        return
    rate_hz = recording.marker_rate_hz
    loaded = ", ".join(f"{start_s:.2f} to {end_s:.2f} s" for start_s, end_s in contacts)
    marked = ", ".join(f"{i / rate_hz:.2f} to {(j - 1) / rate_hz:.2f} s" for i, j in true_runs(seen)) or "never"
    raise NotEstimable(
        "forces-and-markers-apart",
        f"Forces and markers do not overlap: the plates are loaded {loaded}, the markers are seen {marked}.",
        [Fault("plates", f"loaded {loaded}"), Fault("markers", f"seen {marked}")],
    )


def _as_windows(complete: Mask, rate_hz: float) -> list[Window]:
    """Runs of complete frames of at least ``MIN_WINDOW_S``; gaps of one frame are bridged."""
    bridged = complete.copy()
    for i, j in true_runs(~complete):
        if j - i == 1 and i > 0 and j < len(complete):
            bridged[i:j] = True
    windows = [Window(i / rate_hz, (j - 1) / rate_hz) for i, j in true_runs(bridged)]
    return [window for window in windows if window.duration_s >= MIN_WINDOW_S]


def _is_mostly_measured(recording: Recording, plates: list[Plate], window: Window, flight: Mask) -> bool:
    """Whether more than half of the window is load on the plates or flight, and a contact is in it."""
    total_n = vertical_force_n(recording)
    i, j = int(window.start_s * recording.force_rate_hz), int(window.end_s * recording.force_rate_hz) + 1
    loaded = total_n[i:j] > 2.0 * plates[0].threshold_n
    inside = (recording.time_s >= window.start_s) & (recording.time_s <= window.end_s)
    share = float(np.mean(loaded))
    return share * window.duration_s >= _MIN_CONTACT_S and share + float(np.mean(flight[inside])) > 0.5


def _both_feet_lift(feet: tuple[Foot, ...]) -> bool:
    """Whether each foot lifts off at some time (walking, not standing)."""
    return all(not foot.contact.all() for foot in feet)


def _windows_from_load(recording: Recording, plates: list[Plate]) -> tuple[Window, ...]:
    """Windows from pairs of overlapping contacts A, B, assuming a symmetric walk.

    The double support A-B lasts d = end(A) - start(B). The foot before A lifts off d after A's start, the foot after B
    strikes d before B's end, so all force is measured in [start(A) + d, end(B) - d]; d is enlarged by 10 % as a margin.
    """
    contacts = sorted(interval for plate in plates for interval in loaded_intervals(plate, recording.force_rate_hz))
    if not contacts:
        return ()
    if len(contacts) == 1 and contacts[0][1] - contacts[0][0] > 0.98 * recording.duration_s:
        return (Window(contacts[0][0], min(contacts[0][1], recording.duration_s)),)
    spans: list[tuple[float, float]] = []
    for (a0, a1), (b0, b1) in itertools.pairwise(contacts):
        d = 1.1 * (a1 - b0)
        if d <= 0.0 or b1 - d - (a0 + d) < MIN_WINDOW_S:
            continue
        start_s, end_s = a0 + d, b1 - d
        if spans and start_s <= spans[-1][1]:
            spans[-1] = (spans[-1][0], max(end_s, spans[-1][1]))
        else:
            spans.append((start_s, end_s))
    return tuple(Window(start_s, end_s) for start_s, end_s in spans)


_CLEARANCE_M, _MIN_FLIGHT_S, _MIN_FLIGHT_FRAMES = 0.01, 0.05, 5
"""Least height of both feet above the floor, and the shortest flight whose acceleration can be measured."""
_STANDING_PERCENTILE = 5.0
_FREE_FALL_SHARE = 0.3
"""Largest deviation of the acceleration from -g, as a share of g; 0.27 is the largest in 150 flights of 4 runners."""


def flight_frames(recording: Recording, feet: Sequence[Foot], motion: VerticalMotion | None) -> Mask:
    """Frames in which nothing touches the body; False where the motion or the height of a foot is unknown.

    A body on a chair, a rail or a stick may leave the plates as well, but does not fall freely.
    """
    flight = np.zeros(recording.n_frames, dtype=bool)
    loaded = _loaded_frames(recording)
    if motion is None or len(feet) < 2 or not loaded.any():
        return flight
    lifted = ~loaded & np.isfinite(motion.height_m)
    for foot in feet:
        lifted &= _height_above_floor_m(foot) > _CLEARANCE_M
    for i, j in true_runs(lifted):
        if j - i >= max(_MIN_FLIGHT_FRAMES, _MIN_FLIGHT_S * recording.marker_rate_hz):
            fall = 2.0 * np.polyfit(recording.time_s[i:j] - recording.time_s[i], motion.height_m[i:j], 2)[0]
            flight[i:j] = abs(fall + GRAVITY_M_S2) < _FREE_FALL_SHARE * GRAVITY_M_S2
    return flight


def _loaded_frames(recording: Recording) -> Mask:
    """Frames in which a plate in use is loaded."""
    loaded, time_s = np.zeros(recording.n_frames, dtype=bool), recording.time_s
    for plate in recording.plates:
        for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz) if plate.use else ():
            loaded |= (time_s >= start_s) & (time_s <= end_s)
    return loaded


def _height_above_floor_m(foot: Foot) -> Series:
    """Height of the foot's lowest marker above its own height on the floor; NaN where the whole foot is hidden."""
    height_m = foot.markers_m[:, :, 2]
    height_m = height_m[:, np.isfinite(height_m).any(axis=0)]
    above_m = height_m - np.nanpercentile(height_m, _STANDING_PERCENTILE, axis=0)
    lowest_m = np.nan_to_num(above_m, nan=np.inf).min(axis=1, initial=np.inf)
    return np.where(np.isfinite(lowest_m), lowest_m, np.nan)
