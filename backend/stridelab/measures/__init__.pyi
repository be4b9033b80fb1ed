from .angular_momentum import angular_momentum_ranges as angular_momentum_ranges
from .energy_exchange import energy_exchange as energy_exchange
from .extrapolated_com import extrapolated_com as extrapolated_com
from .foot_placement import foot_placement as foot_placement
from .limb_work import limb_work as limb_work
from .local_stability import local_stability as local_stability
from .margin_of_stability import margins_of_stability as margins_of_stability
from .measure import Measure as Measure
from .measure import MeasureSummary as MeasureSummary
from .measure import summarise as summarise
from .measure import symmetry_index as symmetry_index
from .rolling_wheel import rolling_wheel as rolling_wheel
from .spatiotemporal import spatiotemporal as spatiotemporal
from .walk_motion import FootMotion as FootMotion
from .walk_motion import WalkMotion as WalkMotion
from .walk_motion import walk_motion as walk_motion

__all__ = [
    "FootMotion",
    "Measure",
    "MeasureSummary",
    "WalkMotion",
    "angular_momentum_ranges",
    "energy_exchange",
    "extrapolated_com",
    "foot_placement",
    "limb_work",
    "local_stability",
    "margins_of_stability",
    "rolling_wheel",
    "spatiotemporal",
    "summarise",
    "symmetry_index",
    "walk_motion",
]
