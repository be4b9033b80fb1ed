from .library import CentreOfMass as CentreOfMass
from .library import CycloidFit as CycloidFit
from .library import LoadedRecording as LoadedRecording
from .library import PlannedMotion as PlannedMotion
from .library import estimate_com as estimate_com
from .library import fit_cycloid as fit_cycloid
from .library import plan_motion as plan_motion
from .library import read as read
from .robots.loader import load_robot as load_robot

__all__ = [
    "CentreOfMass",
    "CycloidFit",
    "LoadedRecording",
    "PlannedMotion",
    "estimate_com",
    "fit_cycloid",
    "load_robot",
    "plan_motion",
    "read",
]
__version__: str
