from .boundary_conditions import PathBounds as PathBounds
from .contact_wrench import ContactWrench as ContactWrench
from .control import Control as Control
from .force_splines import Shape as Shape
from .free_variables import FreeDurations as FreeDurations
from .hand_force_limits import hand_bounds_n as hand_bounds_n
from .infeasibility.diagnosis import diagnose as diagnose
from .nlp.solvers import Limits as Limits
from .plan import CentroidalPlan as CentroidalPlan
from .point_forces import CircularCones as CircularCones
from .problem import CentroidalProblem as CentroidalProblem
from .receding_horizon import RecedingHorizon as RecedingHorizon
from .receding_horizon import Replan as Replan
from .receding_horizon import State as State
from .rest_to_rest import from_rest_to_rest as from_rest_to_rest
from .solver import solve as solve
from .special_cases.preview_control import PreviewControl as PreviewControl

__all__ = [
    "CentroidalPlan",
    "CentroidalProblem",
    "CircularCones",
    "ContactWrench",
    "Control",
    "FreeDurations",
    "Limits",
    "PathBounds",
    "PreviewControl",
    "RecedingHorizon",
    "Replan",
    "Shape",
    "State",
    "diagnose",
    "from_rest_to_rest",
    "hand_bounds_n",
    "solve",
]
