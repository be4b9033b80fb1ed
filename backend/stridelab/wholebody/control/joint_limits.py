"""Bounds on the joint accelerations that keep positions and velocities inside their limits.

With the distance ``d = q_max - margin - q`` a second-order barrier (Nguyen and Sreenath 2016) requires
``d'' + 2 k d' + k^2 d >= 0``, which is

    q'' <= k^2 d - 2 k q'.

``d`` then decreases at most exponentially, and the bound brakes a joint early enough to stop before its limit; a bound
for the next sample only would brake too late. Velocities approach their limit with the time constant ``1 / k_v``.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from stridelab.conventions import Angles
from stridelab.robots.usable_torques import usable_torques_nm


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of the actuated joints: positions (rad), velocities (rad/s), torques (N m), each ``(na,)``.

    ``friction_nm`` is the dry friction of the joints (N m), zero where the robot's description states none.
    """

    lower_rad: Angles
    upper_rad: Angles
    velocity_rad_s: Angles
    torque_nm: Angles
    friction_nm: Angles

    @staticmethod
    def of_model(model: pin.Model) -> "JointLimits":
        """The limits of a model whose first joint is the floating base."""
        return JointLimits(
            model.lowerPositionLimit[7:].copy(),
            model.upperPositionLimit[7:].copy(),
            model.velocityLimit[6:].copy(),
            model.effortLimit[6:].copy(),
            model.friction[6:].copy(),
        )

    def with_margins(
        self, range_share: float, margin_rad: float, velocity_share: float, torque_share: float
    ) -> "JointLimits":
        """Limits reduced by ``range_share`` of the range and ``margin_rad`` at either end, and by the other shares.

        A motor also overcomes the friction of its joint, which is taken from its torque (``usable_torques_nm``).
        """
        margins_rad = self.margins_rad(range_share, margin_rad)
        return JointLimits(
            self.lower_rad + margins_rad,
            self.upper_rad - margins_rad,
            velocity_share * self.velocity_rad_s,
            usable_torques_nm(torque_share * self.torque_nm, self.friction_nm),
            self.friction_nm,
        )

    def margins_rad(self, range_share: float, margin_rad: float) -> Angles:
        """Margin of every joint: ``range_share`` of its range plus ``margin_rad``."""
        return np.asarray(range_share * (self.upper_rad - self.lower_rad) + margin_rad)

    def acceleration_bounds(
        self, q_rad: Angles, v_rad_s: Angles, k_per_s: float, k_v_per_s: float, most_rad_s2: float
    ) -> tuple[Angles, Angles]:
        """Smallest and largest acceleration ``(na,)``; if they cross, the bound of the nearer limit applies."""
        to_upper, to_lower = self.upper_rad - q_rad, q_rad - self.lower_rad
        upper = np.minimum(k_per_s**2 * to_upper - 2.0 * k_per_s * v_rad_s, k_v_per_s * (self.velocity_rad_s - v_rad_s))
        lower = np.maximum(
            -(k_per_s**2) * to_lower - 2.0 * k_per_s * v_rad_s, -k_v_per_s * (self.velocity_rad_s + v_rad_s)
        )
        # four times as fast as np.clip
        upper, lower = (np.minimum(np.maximum(a, -most_rad_s2), most_rad_s2) for a in (upper, lower))
        crossed = lower > upper
        upper_wins = crossed & (to_upper <= to_lower)
        lower_wins = crossed & ~upper_wins
        return np.where(upper_wins, upper, lower), np.where(lower_wins, lower, upper)
