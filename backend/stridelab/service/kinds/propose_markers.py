"""Proposes the landmarks of a recording's markers. Runs in a killable child of ``POST /marker-sets/propose``."""

from pathlib import Path

from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.trial import read_source
from stridelab.recordings.marker_proposal import propose_marker_map
from stridelab.schemas.marker_sets import MarkerSetProposal, ProposedLabel
from stridelab.schemas.tasks import ParseUploadTask
from stridelab.service.kinds.base import Outcome


def run(task: ParseUploadTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Read ``task.recording``; the summary is a ``MarkerSetProposal`` without an id.

    Raises ``UnreadableFile`` or ``InvalidInput`` with the reader's codes.
    """
    progress(0.1, "reading the file")
    recording = read_source(task.recording, folder)
    proposal = propose_marker_map(recording)
    used = {proposed.label for proposed in proposal.values()}
    summary = MarkerSetProposal(
        recording_id="",
        landmarks={
            landmark: ProposedLabel(label=proposed.label, confidence=round(proposed.confidence, 3))
            for landmark, proposed in proposal.items()
        },
        unassigned=[label for label in recording.markers_m if label not in used],
    )
    return Outcome(summary.model_dump(mode="json"), (), ())
