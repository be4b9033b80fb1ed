"""CoM estimators of chapter 2 as state estimators of the replay's stabiliser.

The robot measures its kinematics, which give the CoM of its model with white noise, and the contact wrenches. The
online complementary filter (2.24)-(2.27) estimates CoM position and velocity from both. The kinematic CoM does not
include a load on the trunk; the central axis of the contact wrench does.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import pinocchio as pin

from stridelab.estimation.complementary.online_filter import OnlineComplementaryFilter
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.robots.robot import Robot
from stridelab.wholebody.replay.disturbances import Disturbances, SensorNoise
from stridelab.wholebody.replay.sensors import SensedState, StateObserver, as_sensed

LOW_HZ: Final = 0.2
"""Above this frequency the filter uses the geometry instead of the axis, which angular momentum displaces."""
HIGH_HZ: Final = 4.0
TABLE_SD_M: Final = (0.01, 0.01, 0.01)
LOW_NOISE, HIGH_NOISE = SensorNoise(0.001, 0.01), SensorNoise(0.005, 0.05)
CONDITIONS: Final[Mapping[str, Disturbances]] = {
    "noise of 1 mm, 0.01 m/s": Disturbances(sensor_noise=LOW_NOISE),
    "5 ms late as well": Disturbances(sensor_noise=LOW_NOISE, delay_s=0.005),
    "5 kg heavier as well": Disturbances(sensor_noise=LOW_NOISE, delay_s=0.005, trunk_mass_kg=5.0),
    "noise of 5 mm, 0.05 m/s": Disturbances(sensor_noise=HIGH_NOISE),
}
"""Conditions under which the estimators are compared."""


def replay_estimators(robot: Robot, noise: SensorNoise) -> Mapping[str, StateObserver]:
    """New instances of the estimators for one replay."""
    return {
        "the simulator's CoM with noise": as_sensed,
        "kinematics alone": KinematicCom(robot, noise.position_m, noise.velocity_m_s),
        "kinematics and forces, filtered": FilteredCom(robot, noise.position_m),
    }


class KinematicCom:
    """CoM position and velocity of the robot's model with white noise; uses no force sensor."""

    def __init__(self, robot: Robot, position_sd_m: float, velocity_sd_m_s: float, seed: int = 0) -> None:
        self._model, self._data = robot.model, robot.model.createData()
        self._sd, self._rng = (position_sd_m, velocity_sd_m_s), np.random.default_rng([seed, 2])

    def __call__(self, sensed: SensedState) -> SensedState:
        """The sensed state with the kinematic CoM instead of the simulator's."""
        pin.centerOfMass(self._model, self._data, sensed.q, sensed.v)
        noise = self._rng.normal(size=(2, 3))
        com_m, com_v = self._data.com[0] + self._sd[0] * noise[0], self._data.vcom[0] + self._sd[1] * noise[1]
        return replace(sensed, com_m=com_m, com_v_m_s=com_v)


class FilteredCom:
    """Complementary filter of the kinematic CoM position and the force sensors; ignores the kinematic velocity."""

    def __init__(self, robot: Robot, position_sd_m: float, seed: int = 0) -> None:
        self._kinematic = KinematicCom(robot, position_sd_m, 0.0, seed)
        self._filter = OnlineComplementaryFilter(
            low_hz=LOW_HZ,
            high_hz=HIGH_HZ,
            mass_kg=robot.mass_kg,
            table_sd_m=TABLE_SD_M,
            priors=ErrorPriors(),
            velocity_m_s=np.zeros(3),
        )
        self._previous: SensedState | None = None

    def __call__(self, sensed: SensedState) -> SensedState:
        """The sensed state with the filter's CoM; a repeated time, due to sensor delay, returns the previous result."""
        if self._previous is not None and sensed.time_s <= self._previous.time_s:
            return self._previous
        sensed = self._kinematic(sensed)
        force = np.sum(list(sensed.forces_n.values()), axis=0)
        moment = np.sum(
            [
                m + np.cross(sensed.contacts[name].position_m, sensed.forces_n[name])
                for name, m in sensed.moments_nm.items()
            ],
            axis=0,
        )
        estimate = self._filter.step(sensed.time_s, sensed.com_m, force, moment)
        self._previous = replace(sensed, com_m=estimate.com_m, com_v_m_s=estimate.velocity_m_s)
        return self._previous
