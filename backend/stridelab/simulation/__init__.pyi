from .ground_truth import TrueMotion as TrueMotion
from .human.walker import HumanWalker as HumanWalker
from .human.walker import Walk as Walk
from .human_recording import SimulatedRecording as SimulatedRecording
from .human_recording import Truth as Truth
from .human_recording import record as record
from .noise import PRESETS as PRESETS
from .noise import MeasurementNoise as MeasurementNoise
from .noise import NoisePreset as NoisePreset
from .robot.walker import RobotWalk as RobotWalk
from .robot_recording import record_robot as record_robot

__all__ = [
    "PRESETS",
    "HumanWalker",
    "MeasurementNoise",
    "NoisePreset",
    "RobotWalk",
    "SimulatedRecording",
    "TrueMotion",
    "Truth",
    "Walk",
    "record",
    "record_robot",
]
