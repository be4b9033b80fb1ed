"""Estimate while somebody moves: samples go to a running service over a websocket, an estimate comes back for each.

Usage: 08_stream_online.py [http://127.0.0.1:8000], where ``make serve`` runs and walk.c3d is (the first example writes
one). A recording stands in for the laboratory; ``stridelab stream walk.c3d`` plays it in real time.
"""

import sys
from pathlib import Path

from stridelab.body.segment_model import SegmentModel
from stridelab.client import Client
from stridelab.recordings.force_windows import require_windows
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.plate_contacts import wrench_track
from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Subject
from stridelab.schemas.streams import StreamConfiguration, StreamSample

recording = read_recording(Path("walk.c3d"))
landmarks = identify(tuple(recording.markers_m)).landmarks
geometry = SegmentModel().com(recording, landmarks, subject=Subject(1.71, 60.0, "female"))
wrench = wrench_track(recording, require_windows(recording, landmarks))

configuration = StreamConfiguration(mass_kg=60.0, rate_hz=recording.marker_rate_hz, format="float32")
service = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
with Client(service) as lab, lab.stream_com(configuration) as stream:
    print(f"{stream.ready.method} at {stream.ready.rate_hz:g} Hz")
    for k, time_s in enumerate(geometry.time_s):
        sample = StreamSample(
            time_s=time_s,
            geometry_m=tuple(geometry.com_m[k]),
            force_n=tuple(wrench.force_n[k]) if wrench.complete[k] else None,
            moment_nm=tuple(wrench.moment_nm[k]) if wrench.complete[k] else None,
        )
        (estimate,) = stream.send([sample])
        if k % 50 == 0:
            x_m, _, z_m = estimate.com_m
            print(f"{estimate.time_s:5.2f} s   x {x_m:6.3f} m   z {z_m:.3f} m   +- {1e3 * estimate.sd_m[0]:.1f} mm")
