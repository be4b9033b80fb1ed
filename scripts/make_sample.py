"""Write models/recordings/sample-walk: a simulated recording with its truth and its estimate.

Run it when an estimator or the simulator changed on purpose; a test says when the shipped files no longer agree.
Usage: make_sample.py [FOLDER]
"""

import hashlib
import json
import sys
from pathlib import Path

from stridelab.machine.models_folder import models_dir
from stridelab.schemas.jobs import EstimateComInput, SimulateRecordingInput, SimulationNoise
from stridelab.schemas.tasks import EstimateComTask, RecordingSource, SimulateRecordingTask
from stridelab.service.filenames import SIMULATED_FACTS_FILE, SIMULATED_RECORDING_FILE, SIMULATED_TRACKS_FILE
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.estimate_com import run as estimate_com
from stridelab.service.kinds.provenance import software_versions
from stridelab.service.kinds.simulate_recording import run as simulate_recording
from stridelab.service.samples.recording import ESTIMATE_JOB, INDEX_FILE, SAMPLE_ID, TRUTH_JOB

FILENAME = "sample-walk.c3d"
WALK = SimulateRecordingInput(
    duration_s=4.0,
    lab="two_plates",
    noise=SimulationNoise(marker_m=0.001, mass_model=0.2, latency_s=0.012),
)
"""As in most laboratories: two plates, a segment table that is not this person's, a force that is 12 ms late."""
ESTIMATE = EstimateComInput(recording_id=SAMPLE_ID, latency="apply")


def make_sample(folder: Path) -> None:
    """Run the two jobs into ``folder`` and write the index that the service seeds its sample from."""
    folder.mkdir(parents=True, exist_ok=True)
    walked = simulate_recording.run(SimulateRecordingTask(input=WALK), folder, _silent)
    source = RecordingSource(file=SIMULATED_RECORDING_FILE, filename=FILENAME)
    estimated = estimate_com.run(EstimateComTask(recording=source, input=ESTIMATE), folder, _silent)
    walked.summary["recording_id"] = SAMPLE_ID
    content = (folder / SIMULATED_RECORDING_FILE).read_bytes()
    index = {
        "filename": FILENAME,
        "sha256": hashlib.sha256(content).hexdigest(),
        "bytes": len(content),
        "facts": json.loads((folder / SIMULATED_FACTS_FILE).read_text(encoding="utf-8")),
        "tracks": SIMULATED_TRACKS_FILE,
        "jobs": {
            TRUTH_JOB: _job("simulate-recording", WALK.model_dump(mode="json"), walked, folder),
            ESTIMATE_JOB: _job("estimate-com", ESTIMATE.model_dump(mode="json"), estimated, folder),
        },
    }
    (folder / INDEX_FILE).write_text(json.dumps(index, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    for name in (SIMULATED_FACTS_FILE, "tracks.csv"):
        (folder / name).unlink()


def _job(kind: str, job_input: dict[str, object], outcome: Outcome, folder: Path) -> dict[str, object]:
    result = outcome.to_json()
    for artifact in result["artifacts"]:
        artifact["bytes"] = (folder / artifact["name"]).stat().st_size
    return {"kind": kind, "input": job_input, "result": {**result, "versions": software_versions()}}


def _silent(_fraction: float, _message: str) -> None:
    pass


if __name__ == "__main__":
    make_sample(Path(sys.argv[1]) if len(sys.argv) > 1 else models_dir() / "recordings" / "sample-walk")
