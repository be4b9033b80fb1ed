from .effector_geometry import effector_shapes as effector_shapes
from .multicontact_api import from_multicontact as from_multicontact
from .multicontact_api import to_multicontact as to_multicontact
from .planner.planner import ContactPlanner as ContactPlanner
from .planner.start_goal import task_ends as task_ends
from .planner.step_limits import EffectorLimits as EffectorLimits
from .planner.step_limits import RobotLimits as RobotLimits
from .scenario_io import sequence_of as sequence_of
from .scenarios.parts import Scenario as Scenario
from .scenarios.stairs import HandRail as HandRail
from .scenarios.stairs import Stairs as Stairs
from .scenarios.stairs import climb as climb
from .scenarios.stairs import descent as descent
from .scenarios.stairs import flat_walk as flat_walk
from .scenarios.stairs import long_stride as long_stride
from .scenarios.stairs import six_stairs as six_stairs
from .scenarios.stairs import stairs_with_rail as stairs_with_rail
from .sequence import Contact as Contact
from .sequence import ContactPhase as ContactPhase
from .sequence import ContactSequence as ContactSequence
from .sequence_swings import swing_of as swing_of
from .swing import SwingCurve as SwingCurve
from .terrain import Box as Box
from .terrain import Rail as Rail
from .terrain import Terrain as Terrain
from .wrench_cones.contact_points import PointContacts as PointContacts
from .wrench_cones.wrench_cone import LinearCone as LinearCone
from .wrench_cones.wrench_cone import LorentzCone as LorentzCone

__all__ = [
    "Box",
    "Contact",
    "ContactPhase",
    "ContactPlanner",
    "ContactSequence",
    "EffectorLimits",
    "HandRail",
    "LinearCone",
    "LorentzCone",
    "PointContacts",
    "Rail",
    "RobotLimits",
    "Scenario",
    "Stairs",
    "SwingCurve",
    "Terrain",
    "climb",
    "descent",
    "effector_shapes",
    "flat_walk",
    "from_multicontact",
    "long_stride",
    "sequence_of",
    "six_stairs",
    "stairs_with_rail",
    "swing_of",
    "task_ends",
    "to_multicontact",
]
