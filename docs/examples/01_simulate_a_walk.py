"""Simulate a person who walks over force plates, and write what a laboratory would have: walk.c3d.

The person never walked, so the true centre of mass is known to the last digit; truth.npz keeps it for the examples that
hold an estimate against it. What the simulation does is in docs/theory/simulated-walker.md.
"""

from pathlib import Path

import numpy as np

from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise

walk = HumanWalker(height_m=1.71, mass_kg=60.0, sex="female", speed_m_s=1.2, duration_s=4.0, seed=1).walk()
noise = MeasurementNoise(marker_m=0.001, mass_model=0.2, latency_s=0.012)
simulated = record(walk, noise, seed=1)

write_c3d(Path("walk.c3d"), simulated.recording)
truth = simulated.truth
np.savez("truth.npz", time_s=truth.time_s, com_m=truth.com_m, force_n=truth.force_n)

markers, plates = len(simulated.recording.markers_m), len(simulated.recording.plates)
print(f"walk.c3d: {markers} markers, {plates} plates, {simulated.recording.duration_s:.1f} s")
