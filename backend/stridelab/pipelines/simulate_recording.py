"""From the parameters of a walker to its recording with the ground truth."""

from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.jobs import SimulateRecordingInput
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import SimulatedRecording, record
from stridelab.simulation.noise import MeasurementNoise
from stridelab.simulation.robot.gait_plan import gait_for
from stridelab.simulation.robot.runner import running_at
from stridelab.simulation.robot.runner import simulate_run as run_talos
from stridelab.simulation.robot.walker import simulate_walk as walk_talos
from stridelab.simulation.robot_recording import record_robot

Keys = tuple[str, ...]
"""Citation keys."""


def simulate_recording(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate a person or TALOS; returns the recording with its truth, and the citation keys of the model.

    Raises ``InvalidInput`` if body or walk are outside the range of the simulation.
    """
    progress(0.02, request.gait)
    return _simulate_talos(request, progress) if request.robot == "talos" else _simulate_human(request, progress)


def _simulate_human(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate a walking human; returns the recording and the citation keys of the body model."""
    person = request.model_dump(include={"height_m", "mass_kg", "sex", "speed_m_s", "duration_s", "seed"})
    walk = HumanWalker(**person).walk()
    progress(0.6, "recording markers and plates")
    return record(walk, _measurement_noise(request), request.seed, lab=request.lab), walk.body.table.references


def _simulate_talos(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate TALOS walking or running; returns the recording and the citation keys of preview control."""
    if request.gait == "running":
        walk = run_talos(running_at(request.speed_m_s, request.duration_s), request.seed)
    else:
        walk = walk_talos(gait_for(request.speed_m_s, request.duration_s), request.seed)
    progress(0.6, "recording markers and plates")
    return record_robot(walk, _measurement_noise(request), request.seed, lab=request.lab), (
        "kajita2003",
        "katayama1985",
    )


def _measurement_noise(request: SimulateRecordingInput) -> MeasurementNoise:
    return MeasurementNoise(**request.noise.model_dump())


def mean_speed_m_s(simulated: SimulatedRecording) -> float:
    """Forward distance of the true CoM over the time of the recording."""
    truth = simulated.truth
    return float((truth.com_m[-1, 0] - truth.com_m[0, 0]) / (truth.time_s[-1] - truth.time_s[0]))
