"""From the parameters of a walker to its recording with the ground truth."""

from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.loader import load_robot
from stridelab.schemas.jobs import SimulateRecordingInput
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import SimulatedRecording, record
from stridelab.simulation.noise import MeasurementNoise
from stridelab.simulation.robot.anatomy import RobotAnatomy, require_weight
from stridelab.simulation.robot.gait_plan import WalkerSize, gait_for
from stridelab.simulation.robot.runner import running_at, simulate_run
from stridelab.simulation.robot.walker import simulate_walk
from stridelab.simulation.robot_recording import record_robot

Keys = tuple[str, ...]
"""Citation keys."""


def simulate_recording(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate a person or a robot; returns the recording with its truth, and the citation keys of the model.

    Raises ``InvalidInput`` if body or walk are outside the range of the simulation, and ``robot-not-recordable`` for a
    robot without two legs of six joints; ``NotFound`` (``robot-not-found``).
    """
    progress(0.02, request.gait)
    return _simulate_human(request, progress) if request.robot == "human" else _simulate_robot(request, progress)


def _simulate_human(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate a walking human; returns the recording and the citation keys of the body model."""
    person = request.model_dump(include={"height_m", "mass_kg", "sex", "speed_m_s", "duration_s", "seed"})
    walk = HumanWalker(**person).walk()
    progress(0.6, "recording markers and plates")
    return record(walk, _measurement_noise(request), request.seed, lab=request.lab), walk.body.table.references


def _simulate_robot(request: SimulateRecordingInput, progress: ProgressCallback) -> tuple[SimulatedRecording, Keys]:
    """Simulate a robot walking, or TALOS running; returns the recording and the citation keys of preview control."""
    robot = load_robot(request.robot)
    anatomy = RobotAnatomy.of_robot(robot)
    require_weight(robot)
    size = WalkerSize(robot.title, anatomy.size, anatomy.spacing_m)
    if request.gait == "running":
        walk = simulate_run(running_at(request.speed_m_s, request.duration_s), request.seed)
    else:
        walk = simulate_walk(gait_for(request.speed_m_s, request.duration_s, size), request.seed, request.robot)
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
