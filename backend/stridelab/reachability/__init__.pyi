from .card import Measure as Measure
from .card import ReachabilityCard as ReachabilityCard
from .gaussian_mixture import Mixture as Mixture
from .kinematics.ik_ground_truth import StanceTruth as StanceTruth
from .learning.kde import KernelDensity as KernelDensity
from .proxy.contact_set_proxy import ContactSet as ContactSet
from .proxy.effector_proxy import Proxy as Proxy
from .proxy.feasibility_correction import FeasibilityCard as FeasibilityCard
from .proxy.level_sets import LevelSet as LevelSet
from .proxy.level_sets import level_sets as level_sets
from .proxy.projections import Grid as Grid
from .proxy.projections import project_mixture as project_mixture
from .store import load_card as load_card
from .store import load_proxies as load_proxies

__all__ = [
    "ContactSet",
    "FeasibilityCard",
    "Grid",
    "KernelDensity",
    "LevelSet",
    "Measure",
    "Mixture",
    "Proxy",
    "ReachabilityCard",
    "StanceTruth",
    "level_sets",
    "load_card",
    "load_proxies",
    "project_mixture",
]
