"""From a C3D file to the centre of mass with its band, in ten lines: one line per stage of chapter 2.

Reads walk.c3d (the first example writes one). ``stridelab estimate walk.c3d`` does the same and also takes out the
delay between force and markers, which the third example shows.
"""

from pathlib import Path

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.force_windows import require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Subject
from stridelab.recordings.total_wrench import wrench_track

recording = read_recording(Path("walk.c3d"))
landmarks = identify(tuple(recording.markers_m)).landmarks
person = Subject(height_m=1.71, mass_kg=60.0, sex="female")
geometry = SegmentModel().com(recording, landmarks, subject=person)
wrench = wrench_track(recording, require_windows(recording, landmarks))
estimate = Smoother().estimate(geometry, wrench, 60.0)
for t, c, sd in zip(estimate.time_s[::50], estimate.com_m[::50], 1e3 * estimate.sd_m[::50], strict=True):
    print(f"{t:5.2f} s   x {c[0]:6.3f}   y {c[1]:6.3f}   z {c[2]:6.3f} m   +- {sd[0]:.0f}, {sd[1]:.0f}, {sd[2]:.0f} mm")
