"""Contact intervals on the plates, and the whole steps between them.

Determines on which plate a foot stands, frame by frame, from its markers and the plate's corners.

Total contact wrench (2.5) at the marker instants: zero-phase low-pass, then interpolation.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg.lapack import dtbtrs

from stridelab.conventions import Mask, Points, Rotation, Series, Vector3
from stridelab.recordings.files.raw import CONTACT_TYPE
from stridelab.recordings.foot_contact import Foot, Outline, resting_outline
from stridelab.recordings.force_plates import plate_axes
from stridelab.recordings.gap_filling import true_runs
from stridelab.recordings.recording import Plate, Recording, Remark, Window, WrenchTrack

_MIN_CONTACT_S = 0.06
_MERGE_S = 0.03
_MIN_PEAK_N = 60.0
_FAR_S = 0.1
_NOISE_FACTOR = 1.5
"""Noise is larger than the largest of the empty plate, if that is seen only briefly, by at most this factor."""
_MIN_STEP_S = 0.25


def loaded_intervals(plate: Plate, rate_hz: float) -> list[tuple[float, float]]:
    """Start and end of each contact in seconds: without noise, ringing and brief touches; brief dips are bridged."""
    load_n, up_n = np.linalg.norm(plate.force_n, axis=1), plate.force_n[:, 2]
    contacts: list[list[tuple[int, int]]] = []
    for run in true_runs(plate.loaded):
        if contacts and run[0] - contacts[-1][-1][1] < _MERGE_S * rate_hz:
            contacts[-1].append(run)
        else:
            contacts.append([run])
    noise_n = _NOISE_FACTOR * float(load_n[empty_samples(plate, rate_hz)].max(initial=0.0))
    spans = [_without_noise(runs, load_n, 2.0 * plate.threshold_n, noise_n) for runs in contacts]
    return [
        (i / rate_hz, (j - 1) / rate_hz)
        for i, j in spans
        if (j - i >= _MIN_CONTACT_S * rate_hz or j - i == len(up_n)) and float(up_n[i:j].max()) > _MIN_PEAK_N
    ]


def empty_samples(plate: Plate, rate_hz: float) -> Mask:
    """Samples of the empty plate, far from what only a contact explains."""
    load_n, far = np.linalg.norm(plate.force_n, axis=1), round(_FAR_S * rate_hz)
    empty = np.ones(len(load_n), dtype=bool)
    for i, j in true_runs(plate.loaded):
        if float(load_n[i:j].max()) > _MIN_PEAK_N:
            empty[max(0, i - far) : j + far] = False
    return empty


def _without_noise(runs: list[tuple[int, int]], load_n: Series, low_n: float, noise_n: float) -> tuple[int, int]:
    """First sample of a contact of these loaded runs, and the one after its last, without noise before and after it.

    A run at either end is noise if its load does not exceed ``noise_n``, or if it is briefer than the pause beside it
    and below ``low_n``. With noise of 5 N in each axis, one of thousand samples of an empty plate exceeds 20 N.
    """

    def is_noise(k: int, beside: int) -> bool:
        (i, j), (first, end) = runs[k], runs[beside]
        peak_n = float(load_n[i:j].max())
        return peak_n <= noise_n or (peak_n < low_n and j - i < max(first - j, i - end))

    while len(runs) > 1 and is_noise(0, 1):
        runs = runs[1:]
    while len(runs) > 1 and is_noise(-1, -2):
        runs = runs[:-1]
    return runs[0][0], runs[-1][1]


def whole_steps(recording: Recording, window: Window) -> list[tuple[float, float]]:
    """Longest intervals of the window with a whole number of steps: strike to strike, and lift-off to lift-off.

    Strikes and lift-offs are those of the plates; the window's start is a lift-off and its end a strike (of a foot
    beside the plates) unless the recording itself starts or ends there.
    """
    frame_s = 1.0 / recording.marker_rate_hz
    strikes: list[float] = []
    lifts: list[float] = []
    for plate in recording.plates:
        if plate.use:
            for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz):
                strikes.append(start_s)
                lifts.append(end_s)
    inside = (window.start_s + frame_s, window.end_s - frame_s)
    strikes = [t for t in strikes if inside[0] < t < inside[1]]
    lifts = [t for t in lifts if inside[0] < t < inside[1]]
    if strikes and window.end_s < recording.duration_s - 2.5 * frame_s:
        strikes.append(window.end_s)
    if lifts and window.start_s > 1.5 * frame_s:
        lifts.append(window.start_s)
    spans = [(min(instants), max(instants)) for instants in (strikes, lifts) if instants]
    return [(first_s, last_s) for first_s, last_s in spans if last_s - first_s >= _MIN_STEP_S]


def fore_aft_remarks(plates: tuple[Plate, ...], direction: Vector3 | None, rate_hz: float) -> list[Remark]:
    """Remark on plates that may be turned: they show propulsion before braking in every contact."""
    if direction is None:
        return []
    turned = []
    for plate in plates:
        along_n = plate.force_n @ direction
        signs = []
        for start_s, end_s in loaded_intervals(plate, rate_hz):
            i, j = round(start_s * rate_hz), round(end_s * rate_hz)
            k = (i + j) // 2
            brake_n, push_n = float(along_n[i:k].mean()), float(along_n[k:j].mean())
            if j - i >= 0.25 * rate_hz and min(abs(brake_n), abs(push_n)) > 0.02 * float(plate.force_n[i:j, 2].mean()):
                signs.append(brake_n > 0.0 > push_n)
        if signs and all(signs):
            turned.append(plate.index)
    if not turned:
        return []
    which = ", ".join(str(index) for index in turned)
    message = f"Plate {which}: the foot speeds up when it lands and slows down when it leaves; the plate may be turned."
    return [Remark("fore-aft-reversed", message)]


def vertical_force_n(recording: Recording) -> Series:
    """Upward force of all plates in use at the force rate."""
    return np.asarray(np.sum([plate.force_n[:, 2] for plate in recording.plates if plate.use], axis=0))


STAIR_M = 0.05
"""Height difference above which plates are treated as steps of a stair."""
SLACK_S = 0.1
"""Tolerance between landing or lift-off in the markers and in the load."""
_EDGE_M = 0.03
"""Distance by which a marker of a foot on a plate may lie outside the plate: markers sit on the skin."""
_OUTLINE_EDGE_M = 0.02
"""Tolerance of the foot outline: its error is about 1 cm, and its outermost centimetre carries little load."""
_BRIEF_S = 0.05
_BELOW_M, _SOLE_M = 0.06, 0.12
"""Range of the lowest marker of a standing foot below and above the plate's surface."""
_OVERHANG_M = 0.12
"""Length of a foot that may protrude over the edge of a step."""
_COP_REACH_M = 0.15


def loaded_frames(recording: Recording, plate: Plate) -> Mask:
    """Frames at which the plate is loaded, widened by ``SLACK_S`` on both sides."""
    loaded = np.zeros(recording.n_frames, dtype=bool)
    time_s = recording.time_s
    for start_s, end_s in loaded_intervals(plate, recording.force_rate_hz):
        loaded |= (time_s >= start_s - SLACK_S) & (time_s <= end_s + SLACK_S)
    return loaded


def markers_on_plate(recording: Recording, plate: Plate, foot: Foot) -> Bool[np.ndarray, "n markers"]:
    """Per frame and marker: whether the marker is above this plate; False for a plate that is never loaded.

    A contact without a plate has no surface; the foot must then be at its centre of pressure while it is loaded.
    """
    loaded = loaded_frames(recording, plate)
    if not loaded.any():
        return np.zeros(foot.markers_m.shape[:2], dtype=bool)
    if plate.type == CONTACT_TYPE:
        return np.repeat(_stands_at_cop(recording, plate, foot)[:, None], foot.markers_m.shape[1], axis=1)
    return _markers_over(plate, foot, _EDGE_M)


def outline_off_plates(recording: Recording, plates: list[Plate], foot: Foot, outline_m: Outline) -> Mask:
    """Frames in which a part of the foot that may carry load lies outside all plates that are loaded at some time.

    ``outline_m`` is the result of ``foot_outline``. The contacts of a force file have no edges; the mask is then False.
    Excursions of less than 50 ms (landing and lift-off) are ignored.
    """
    if any(plate.type == CONTACT_TYPE for plate in plates):
        return np.zeros(len(foot.contact), dtype=bool)
    beside = resting_outline(foot) & np.isfinite(outline_m).all(axis=2)
    for plate in plates:
        if loaded_intervals(plate, recording.force_rate_hz):
            beside &= ~(_inside_edges(plate, outline_m, _OUTLINE_EDGE_M) & _at_height(plate, foot)[:, None])
    lasting: Mask = beside.any(axis=1)
    for i, j in true_runs(lasting):
        if j - i < _BRIEF_S * recording.marker_rate_hz and i > 0 and j < len(lasting):
            lasting[i:j] = False
    return lasting


def main_plate(under: Bool[np.ndarray, "plates n markers"], foot: Foot) -> Int[np.ndarray, " n"]:
    """Index of the plate under most of the foot's resting markers; -1 if there is none."""
    count = (under & foot.resting).sum(axis=2)
    return np.asarray(np.where(count.max(axis=0) > 0, np.argmax(count, axis=0), -1))


def step_overhang_contacts(plates: list[Plate], foot: Foot) -> Mask:
    """Contacts on stairs in which the foot stands on one step, with one end protruding over the edge.

    The overhang cannot carry load, so a contact that is on a step in most of its frames counts as on it in all frames.
    """
    held = np.zeros(len(foot.contact), dtype=bool)
    for plate in plates:
        over, near = _markers_over(plate, foot, _EDGE_M), _markers_over(plate, foot, _OVERHANG_M)
        standing = np.any(over & foot.resting, axis=1) & np.all(near | ~foot.resting, axis=1)
        for i, j in true_runs(foot.contact):
            if standing[i:j].mean() > 0.5:
                held[i:j] = True
    return held


def _markers_over(plate: Plate, foot: Foot, edge_m: float) -> Bool[np.ndarray, "n markers"]:
    """Markers above the plate widened by ``edge_m`` on all sides, in frames in which the sole is at its height."""
    return np.asarray(_inside_edges(plate, foot.markers_m, edge_m) & _at_height(plate, foot)[:, None])


def _inside_edges(
    plate: Plate, points_m: Float[np.ndarray, "n points 3"], edge_m: float
) -> Bool[np.ndarray, "n points"]:
    """Points above or below the plate widened by ``edge_m`` on all sides."""
    R: Rotation = plate_axes(plate.corners_m)
    local = (points_m - plate.corners_m.mean(axis=0)) @ R
    half_x = 0.5 * np.linalg.norm(plate.corners_m[0] - plate.corners_m[1]) + edge_m
    half_y = 0.5 * np.linalg.norm(plate.corners_m[0] - plate.corners_m[3]) + edge_m
    return np.asarray((np.abs(local[..., 0]) <= half_x) & (np.abs(local[..., 1]) <= half_y))


def _at_height(plate: Plate, foot: Foot) -> Mask:
    """Frames in which the foot's lowest marker is as high above the plate as a standing foot's."""
    R: Rotation = plate_axes(plate.corners_m)
    local = (foot.markers_m - plate.corners_m.mean(axis=0)) @ R
    lowest = np.nan_to_num(local[..., 2] * np.sign(R[2, 2]), nan=np.inf).min(axis=1)
    return np.asarray((lowest > -_BELOW_M) & (lowest < _SOLE_M))


def _stands_at_cop(recording: Recording, plate: Plate, foot: Foot) -> Mask:
    """Frames of the stances whose centre of pressure, while the contact is loaded, lies at the foot.

    The load-weighted share of close frames decides for a stance as a whole. At small loads, as in double support, the
    centre of pressure is noise, and a decision per frame would leave holes in the stance.
    """
    loaded = loaded_frames(recording, plate)
    near = _near_cop(recording, plate, foot)
    time_s = np.arange(len(plate.force_n)) / recording.force_rate_hz
    load_n = np.maximum(np.interp(recording.time_s, time_s, plate.force_n[:, 2]), 0.0)
    stands = np.zeros(len(near), dtype=bool)
    for i, j in true_runs(foot.contact & loaded):
        total_n = float(load_n[i:j].sum())
        stands[i:j] = total_n > 0.0 and float(load_n[i:j][near[i:j]].sum()) > 0.5 * total_n
    return stands


def _near_cop(recording: Recording, plate: Plate, foot: Foot) -> Mask:
    """Whether the foot, as the line from its first to the middle of its other markers, is within 15 cm of the COP."""
    cop = _cop_at_frames(recording, plate)
    heel, fore = foot.markers_m[:, 0, :2], mean_visible(foot.markers_m[:, 1:, :2])
    along = fore - heel
    share = np.clip(((cop - heel) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9), 0.0, 1.2)
    return np.asarray(np.linalg.norm(heel + share[:, None] * along - cop, axis=1) < _COP_REACH_M)


def _cop_at_frames(recording: Recording, plate: Plate) -> Float[np.ndarray, "n 2"]:
    """Centre of pressure at the contact's height per frame; unloaded frames take the nearest loaded sample."""
    f, nu = plate.force_n, plate.moment_nm
    loaded = plate.loaded & (np.abs(f[:, 2]) > plate.threshold_n)
    if not loaded.any():
        return np.full((recording.n_frames, 2), np.nan)
    z = float(plate.corners_m[:, 2].mean())
    x = (f[loaded, 0] * z - nu[loaded, 1]) / f[loaded, 2]
    y = (f[loaded, 1] * z + nu[loaded, 0]) / f[loaded, 2]
    at_s = np.flatnonzero(loaded) / recording.force_rate_hz
    after = np.minimum(np.searchsorted(at_s, recording.time_s), len(at_s) - 1)
    before = np.maximum(after - 1, 0)
    closer = recording.time_s - at_s[before] < at_s[after] - recording.time_s
    nearest = np.where(closer, before, after)
    return np.column_stack([x[nearest], y[nearest]])


def mean_visible(points: Float[np.ndarray, "n markers axes"]) -> Float[np.ndarray, "n axes"]:
    """Mean over the visible markers; NaN where none is visible."""
    seen = ~np.isnan(points)
    count = seen.sum(axis=1)
    total = np.where(seen, points, 0.0).sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


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


LOW_PASS_HZ = 50.0
"""Second order, forward and backward; passes gait (below 20 Hz) and removes plate ringing."""


def wrench_track(recording: Recording, windows: tuple[Window, ...], *, latency_s: float = 0.0) -> WrenchTrack:
    """Sum of the plates in use, sampled *at* the marker instants.

    ``latency_s`` > 0 is the delay of the force, which is then read that much later. ``complete`` marks the frames
    inside a window; with a latency, frames read beyond the recorded force are not complete. Filtering and interpolation
    are used because block means would shift the force by half a block (4.7 ms at 1500 to 100 Hz).
    """
    time_s = recording.time_s
    complete = np.zeros(len(time_s), dtype=bool)
    for window in windows:
        complete |= (time_s >= window.start_s - 1e-9) & (time_s <= window.end_s + 1e-9)
    used = [plate for plate in recording.plates if plate.use]
    if not used:
        nothing = np.zeros((len(time_s), 3))
        return WrenchTrack(time_s, nothing, nothing.copy(), np.zeros_like(complete), windows, latency_s)
    n = len(used[0].force_n)
    read_at_s = time_s + latency_s
    force_time_s = np.arange(n) / recording.force_rate_hz
    complete &= (read_at_s >= 0.0) & (read_at_s <= force_time_s[-1])
    tracks = []
    for total in (
        np.sum([plate.force_n for plate in used], axis=0),
        np.sum([plate.moment_nm for plate in used], axis=0),
    ):
        smooth = low_pass(total, recording.force_rate_hz)
        tracks.append(np.column_stack([np.interp(read_at_s, force_time_s, smooth[:, j]) for j in range(3)]))
    return WrenchTrack(time_s, tracks[0], tracks[1], complete, windows, latency_s)


def sampled_wrench(plate: Plate, rate_hz: float, at_s: Float[np.ndarray, "m"]) -> tuple[Points, Points]:
    """Low-passed force and moment of a plate at some instants, each (m, 3); ``rate_hz`` is that of the plate."""
    time_s = np.arange(len(plate.force_n)) / rate_hz
    smooth = [low_pass(track, rate_hz) for track in (plate.force_n, plate.moment_nm)]
    force, moment = (np.column_stack([np.interp(at_s, time_s, t[:, axis]) for axis in range(3)]) for t in smooth)
    return force, moment


def low_pass(track: Points, rate_hz: float) -> Points:
    """Zero-phase Butterworth low-pass at ``LOW_PASS_HZ``; too short or too slowly sampled tracks are unchanged."""
    if rate_hz <= 2.5 * LOW_PASS_HZ or len(track) <= 16:
        return track
    return filter_both_ways(track, rate_hz, LOW_PASS_HZ, 9)


def filter_both_ways(
    track: Float[np.ndarray, "n *axes"], rate_hz: float, band_hz: float, pad: int
) -> Float[np.ndarray, "n *axes"]:
    """Second-order Butterworth low-pass, forward and backward, of a track continued oddly by ``pad`` samples.

    ``sosfiltfilt(butter(2, band_hz, fs=rate_hz, output="sos"), track, axis=0, padlen=pad)`` of ``scipy.signal``, whose
    import takes longer than the estimation of a walk. The pass y = x_0 + H (x - x_0) starts at rest, since H(1) = 1.
    """
    k = np.tan(np.pi * band_hz / rate_hz)
    a = np.array([1.0 + np.sqrt(2.0) * k + k**2, 2.0 * (k**2 - 1.0), 1.0 - np.sqrt(2.0) * k + k**2])
    x = track.reshape(len(track), -1)
    x = np.concatenate([2.0 * x[0] - x[pad:0:-1], x, 2.0 * x[-1] - x[-2 : -pad - 2 : -1]])
    recursion = np.repeat((a / a[0])[:, None], len(x), axis=1)
    for _ in range(2):
        inner = x - x[0]
        inner[2:] += 2.0 * inner[1:-1] + inner[:-2]
        inner[1] += 2.0 * inner[0]
        x = (x[0] + dtbtrs(recursion, k**2 / a[0] * inner, uplo="L")[0])[::-1]
    return np.asarray(x[pad : len(x) - pad].reshape(track.shape))
