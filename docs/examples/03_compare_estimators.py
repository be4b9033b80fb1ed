"""Compare all estimators on one recording whose truth is known, with and without the delay of the force taken out.

Reads walk.c3d and truth.npz of the first example. On a recording of your own leave ``truth`` away: the estimators are
then held against physics (force held back, flight, standing), which ``stridelab compare`` prints as a table.
"""

from functools import partial
from pathlib import Path

import numpy as np

from stridelab.body.segment_model import SegmentModel
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.evaluation.comparison import ComparisonData, KnownMotion, compare
from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.force_windows import require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Subject

MASS_KG = 60.0
ESTIMATORS = {
    "markers only": GeometryOnly(),
    "complementary, as in the thesis": ComplementaryFilter.thesis(),
    "complementary": ComplementaryFilter(),
    "kalman": KalmanFilter.tuned(),
    "rts": RtsSmoother.tuned(),
    "smoother": Smoother(),
}

recording = read_recording(Path("walk.c3d"))
landmarks = identify(tuple(recording.markers_m)).landmarks
geometry = SegmentModel().com(recording, landmarks, subject=Subject(1.71, MASS_KG, "female"))
wrench_at = partial(wrench_track, recording, require_windows(recording, landmarks))
known = np.load("truth.npz")
truth = KnownMotion(known["com_m"], known["force_n"])

late_s = estimate_latency(geometry, lambda lag_s: wrench_at(latency_s=lag_s), MASS_KG).latency_s
print(f"the force is late by {1e3 * late_s:.1f} ms")
for applied_s in (0.0, late_s):
    print(f"\nRMS error with {1e3 * applied_s:.1f} ms taken out, mm   ahead  lateral  vertical")
    found = compare(ESTIMATORS, ComparisonData(geometry, wrench_at(latency_s=applied_s), MASS_KG, truth))
    for name, assessment in found.assessments.items():
        assert assessment.truth is not None
        ahead, lateral, vertical = 1e3 * assessment.truth.rms_m
        print(f"  {name:40s} {ahead:6.2f}   {lateral:6.2f}    {vertical:6.2f}")
