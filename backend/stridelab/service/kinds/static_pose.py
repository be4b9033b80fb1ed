"""Reads the static pose of a stored recording. Runs in a killable child of ``WS /stream/markers``."""

from pathlib import Path

import numpy as np

from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import read_source
from stridelab.schemas.tasks import ParseUploadTask
from stridelab.service.kinds.base import Outcome


def run(task: ParseUploadTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Median position of each marker of ``task.recording`` that is ever seen, in metres with z up.

    Raises ``UnreadableFile`` or ``InvalidInput`` with the reader's codes.
    """
    progress(0.1, "reading the file")
    recording = read_source(task.recording, folder)
    seen = {label: track[np.isfinite(track).all(axis=1)] for label, track in recording.markers_m.items()}
    pose = {label: np.median(track, axis=0).tolist() for label, track in seen.items() if len(track)}
    return Outcome(pose, (), ())
