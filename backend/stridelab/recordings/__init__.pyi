from .body_mass import MassEstimate as MassEstimate
from .body_mass import weigh as weigh
from .files.c3d_writer import write_c3d as write_c3d
from .foot_contact import Foot as Foot
from .foot_contact import find_feet as find_feet
from .force_windows import find_windows as find_windows
from .force_windows import measured_windows as measured_windows
from .force_windows import require_windows as require_windows
from .marker_sets import MarkerSetMatch as MarkerSetMatch
from .marker_sets import identify as identify
from .plate_contacts import low_pass as low_pass
from .plate_contacts import wrench_track as wrench_track
from .reader import read_recording as read_recording
from .recording import Event as Event
from .recording import Plate as Plate
from .recording import PlateSwitches as PlateSwitches
from .recording import Recording as Recording
from .recording import Side as Side
from .recording import Subject as Subject
from .recording import Window as Window
from .recording import WrenchTrack as WrenchTrack
from .remark import Remark as Remark
from .static_pose import stands_still as stands_still

__all__ = [
    "Event",
    "Foot",
    "MarkerSetMatch",
    "MassEstimate",
    "Plate",
    "PlateSwitches",
    "Recording",
    "Remark",
    "Side",
    "Subject",
    "Window",
    "WrenchTrack",
    "find_feet",
    "find_windows",
    "identify",
    "low_pass",
    "measured_windows",
    "read_recording",
    "require_windows",
    "stands_still",
    "weigh",
    "wrench_track",
    "write_c3d",
]
