from .spatial import Placement as Placement
from .spatial import cross as cross
from .wrench import Wrench as Wrench
from .wrench import com_acceleration as com_acceleration
from .wrench import contact_force as contact_force
from .wrench import contact_wrench as contact_wrench
from .wrench import momentum_rate as momentum_rate
from .wrench import transport as transport
from .wrench import zmp_linearised as zmp_linearised
from .wrench import zmp_of_motion as zmp_of_motion

__all__ = [
    "Placement",
    "Wrench",
    "com_acceleration",
    "contact_force",
    "contact_wrench",
    "cross",
    "momentum_rate",
    "transport",
    "zmp_linearised",
    "zmp_of_motion",
]
