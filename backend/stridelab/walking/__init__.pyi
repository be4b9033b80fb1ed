from .curtate_cycloid import Wheel as Wheel
from .gait_events import find_contacts as find_contacts
from .path_fit import PathFit as PathFit
from .path_fit import fit_path as fit_path
from .population.correlations import Correlation as Correlation
from .population.mixed_model import MixedModel as MixedModel
from .population.population import Population as Population
from .population.population import study as study
from .preconditions import require_steps as require_steps
from .preconditions import require_walk as require_walk
from .step_fit import StepFit as StepFit
from .step_fit import fit_step as fit_step
from .step_fit import fit_steps as fit_steps
from .step_variability import Overlap as Overlap
from .step_variability import strike_to_strike as strike_to_strike
from .steps import GaitStep as GaitStep
from .steps import find_steps as find_steps
from .timed_fit import TimedFit as TimedFit

__all__ = [
    "Correlation",
    "GaitStep",
    "MixedModel",
    "Overlap",
    "PathFit",
    "Population",
    "StepFit",
    "TimedFit",
    "Wheel",
    "find_contacts",
    "find_steps",
    "fit_path",
    "fit_step",
    "fit_steps",
    "require_steps",
    "require_walk",
    "strike_to_strike",
    "study",
]
