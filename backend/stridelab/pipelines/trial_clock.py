"""What one trial says of its session's clock and of the person's mass, from the file and its switches alone.

Both are stored with the facts of an upload, so that the values of a session need no file to be read again.
"""

from functools import partial

from stridelab.body.segment_model import SegmentModel
from stridelab.errors import StridelabError
from stridelab.estimation.latency import estimate_latency
from stridelab.pipelines.trial import Trial
from stridelab.recordings.body_mass import MassEstimate, best_mass
from stridelab.recordings.recording import Recording, Subject, Window, WrenchTrack
from stridelab.recordings.total_wrench import wrench_track
from stridelab.schemas.recordings import TrialClock


def weight_of(trial: Trial) -> MassEstimate | None:
    """The mass from the force of this trial, None where it shows none; ``sd_kg`` leaves out the plates' calibration."""
    return best_mass(trial.masses)


def clock_of(trial: Trial) -> TrialClock | None:
    """The latency of the force in this trial; None where the clocks cannot be compared.

    The mass is the file's, else that of the plates; nothing that is stated about the person enters. An upload is
    accepted whatever goes wrong here.
    """
    recording, mass_kg = trial.recording, trial.recording.subject.mass_kg or trial.force_mass_kg
    if trial.match.name is None or not trial.windows or mass_kg is None:
        return None
    in_file = recording.subject
    subject = Subject(in_file.height_m, mass_kg, in_file.sex, in_file.age_years)
    try:
        geometric = SegmentModel().com(recording, trial.match.landmarks, subject=subject)
        found = estimate_latency(geometric, partial(_wrench_at, recording, trial.windows), mass_kg)
    except (StridelabError, ArithmeticError, ValueError):
        return None
    return TrialClock(latency_s=found.latency_s, sd_s=found.sd_s)


def _wrench_at(recording: Recording, windows: tuple[Window, ...], latency_s: float) -> WrenchTrack:
    return wrench_track(recording, windows, latency_s=latency_s)
