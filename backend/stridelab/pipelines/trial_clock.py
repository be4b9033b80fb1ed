"""Force latency and body mass estimated from one trial, using only its file and plate switches.

Both are stored with the facts of an upload, so that session values are computed without reading files again.
"""

from stridelab.body.segment_model import SegmentModel
from stridelab.errors import StridelabError
from stridelab.estimation.latency import estimate_latency
from stridelab.pipelines.trial import Trial
from stridelab.recordings.body_mass import MassEstimate, best_mass
from stridelab.recordings.recording import Subject
from stridelab.recordings.total_wrench import wrench_track
from stridelab.schemas.recordings import TrialClock


def force_mass_of(trial: Trial) -> MassEstimate | None:
    """Mass estimated from the force of this trial, None if impossible; ``sd_kg`` excludes the plates' calibration."""
    return best_mass(trial.masses)


def clock_of(trial: Trial) -> TrialClock | None:
    """Latency of the force in this trial; None if it cannot be estimated.

    Uses the mass in the file, else the mass from the plates, but no value given by the user. Errors return None, so
    that they do not prevent an upload.
    """
    recording, mass_kg = trial.recording, trial.recording.subject.mass_kg or trial.force_mass_kg
    if trial.match.name is None or not trial.windows or mass_kg is None:
        return None
    in_file = recording.subject
    subject = Subject(in_file.height_m, mass_kg, in_file.sex, in_file.age_years)
    try:
        geometric = SegmentModel().com(recording, trial.match.landmarks, subject=subject)
        latency = estimate_latency(
            geometric, lambda latency_s: wrench_track(recording, trial.windows, latency_s=latency_s), mass_kg
        )
    except (StridelabError, ArithmeticError, ValueError):
        return None
    return TrialClock(latency_s=latency.latency_s, sd_s=latency.sd_s)
