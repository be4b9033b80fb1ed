"""Everything that a simulated recording has measured, as one vector to compare."""

import numpy as np

from stridelab.simulation.human_recording import SimulatedRecording


def all_measured(simulated: SimulatedRecording) -> np.ndarray:
    """Markers and plate forces, one after the other."""
    recording = simulated.recording
    markers = np.column_stack(list(recording.markers_m.values())).ravel()
    return np.concatenate([markers, *(plate.force_n.ravel() for plate in recording.plates)])
