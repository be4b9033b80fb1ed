from .certificate.certificate import Certificate as Certificate
from .certificate.certify import certify as certify
from .control.controller import WholeBodyController as WholeBodyController
from .momentum_consistency import agree as agree
from .motion import WholeBodyMotion as WholeBodyMotion
from .motion import WholeBodyStopped as WholeBodyStopped
from .replay.disturbances import Disturbances as Disturbances
from .replay.disturbances import Push as Push
from .replay.disturbances import SensorNoise as SensorNoise
from .replay.log import Replay as Replay
from .replay.replay import PhysicsReplay as PhysicsReplay

__all__ = [
    "Certificate",
    "Disturbances",
    "PhysicsReplay",
    "Push",
    "Replay",
    "SensorNoise",
    "WholeBodyController",
    "WholeBodyMotion",
    "WholeBodyStopped",
    "agree",
    "certify",
]
