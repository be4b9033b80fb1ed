from .newton_euler import com_acceleration as com_acceleration
from .newton_euler import contact_force as contact_force
from .newton_euler import contact_wrench as contact_wrench
from .newton_euler import momentum_rate as momentum_rate
from .spatial import Placement as Placement
from .spatial import cross as cross
from .wrench import Wrench as Wrench
from .wrench import transport as transport
from .zmp import zmp_linearised as zmp_linearised
from .zmp import zmp_of_motion as zmp_of_motion

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
