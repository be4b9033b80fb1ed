"""Fit the rolling wheel of chapter 3 to every step: radius R of the wheel, r of the point on it, height z0 of the hub.

Reads walk.c3d (the first example writes one). What the numbers are worth is in docs/theory/rolling-wheel.md; with
intervals and simpler curves beside them: ``stridelab fit-cycloid walk.c3d``.
"""

from pathlib import Path

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.force_windows import require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Subject
from stridelab.walking.step_fit import fit_steps
from stridelab.walking.steps import find_steps

recording = read_recording(Path("walk.c3d"))
landmarks = identify(tuple(recording.markers_m)).landmarks
windows = require_windows(recording, landmarks)
geometry = SegmentModel().com(recording, landmarks, subject=Subject(1.71, 60.0, "female"))
estimate = Smoother().estimate(geometry, wrench_track(recording, windows), 60.0)

steps = find_steps(recording, landmarks, windows)
assert recording.walking_direction is not None, "nobody walks here"
fits = fit_steps(estimate, [step for step in steps if step.measured], recording.walking_direction, windows)

print("step     begins  length    R       r       z0      off the curve")
for fit in fits:
    wheel = fit.path.wheel
    length = "   -  " if fit.step.length_m is None else f"{fit.step.length_m:.3f} m"
    print(
        f"{fit.step.side:5s} {fit.step.start_s:6.2f} s  {length}  {wheel.R_m:.3f}   {wheel.r_m:.4f}   "
        f"{wheel.z0_m:.3f} m   {1e3 * fit.path.distance_m.mean():.1f} mm"
    )
