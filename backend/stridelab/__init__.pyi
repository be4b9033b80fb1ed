from .library.imitation import ImitatedWalk as ImitatedWalk
from .library.imitation import imitate as imitate
from .library.measures import GaitMeasures as GaitMeasures
from .library.measures import GaitReport as GaitReport
from .library.measures import gait_measures as gait_measures
from .library.measures import gait_report as gait_report
from .library.plans import PlannedMotion as PlannedMotion
from .library.plans import PushedMotion as PushedMotion
from .library.plans import plan_motion as plan_motion
from .library.plans import push_basin as push_basin
from .library.recordings import CentreOfMass as CentreOfMass
from .library.recordings import CycloidFit as CycloidFit
from .library.recordings import LoadedRecording as LoadedRecording
from .library.recordings import estimate_com as estimate_com
from .library.recordings import fit_cycloid as fit_cycloid
from .library.recordings import read as read
from .robots.loader import load_robot as load_robot

__all__ = [
    "CentreOfMass",
    "CycloidFit",
    "GaitMeasures",
    "GaitReport",
    "ImitatedWalk",
    "LoadedRecording",
    "PlannedMotion",
    "PushedMotion",
    "estimate_com",
    "fit_cycloid",
    "gait_measures",
    "gait_report",
    "imitate",
    "load_robot",
    "plan_motion",
    "push_basin",
    "read",
]
__version__: str
