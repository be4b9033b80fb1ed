"""Simulated sensors of the replay control, with noise and delay.

``StateObserver`` is the interface of a state estimator: it maps the sensed state to the state that the stabiliser uses.
The default is the identity.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement, cross
from stridelab.wholebody.replay.disturbances import Disturbances
from stridelab.wholebody.replay.simulation import Simulation


@dataclass(frozen=True, eq=False)
class SensedState:
    """Sensed state: coordinates in pinocchio's order, CoM and its velocity, per effector placement, force and moment.

    ``moments_nm`` are those of the environment about the effector's position, as measured by a sensor there.
    """

    time_s: float
    q: Float[np.ndarray, "nq"]
    v: Float[np.ndarray, "nv"]
    com_m: Vector3
    com_v_m_s: Vector3
    contacts: Mapping[str, Placement]
    forces_n: Mapping[str, Vector3]
    moments_nm: Mapping[str, Vector3]


StateObserver = Callable[[SensedState], SensedState]


def as_sensed(state: SensedState) -> SensedState:
    """Identity observer: no estimator."""
    return state


class JointReadings:
    """Angles and rates of the moving joints as the joint control reads them, ``delay_s`` late.

    The delay is rounded to whole steps of the simulator. Until a reading is old enough, the first one is returned.
    """

    def __init__(self, simulation: Simulation, delay_s: float) -> None:
        self._simulation = simulation
        late_steps = round(delay_s / simulation.timestep_s)
        self._readings: deque[tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]] = deque(maxlen=late_steps + 1)

    def read_joints(self) -> tuple[Float[np.ndarray, "na"], Float[np.ndarray, "na"]]:
        """The delayed angles (rad) and rates (rad/s); call once before every step."""
        self._readings.append((self._simulation.joints_rad, self._simulation.joint_rates_rad_s))
        return self._readings[0]


class SimulatedSensors:
    """Simulated sensors: adds noise to the simulator's state and returns it after the delay ``delay_s``.

    Readings are taken at steps of the simulator, of which there are ``substeps`` between two calls of ``read_state``:
    the delay is rounded to whole steps. Until a reading is old enough, the first one is returned.
    """

    def __init__(self, simulation: Simulation, disturbed: Disturbances, substeps: int) -> None:
        self._simulation, self._noise = simulation, disturbed.sensor_noise
        self._rng = np.random.default_rng([disturbed.seed, 1])
        late_steps = round(disturbed.delay_s / simulation.timestep_s)
        self._taken_after = -late_steps % substeps
        """Steps after a call of ``read_state`` at which the reading for a later call is taken; 0: at the call."""
        size = -(-late_steps // substeps) + int(self._taken_after == 0)
        self._readings: deque[SensedState] = deque(maxlen=size)

    def after_step(self, done: int, time_s: float) -> None:
        """Call after every step; ``done`` is the number of steps since the last call of ``read_state``."""
        if self._taken_after and done == self._taken_after:
            self._simulation.refresh_derived()
            self._readings.append(self._add_noise(self._current_state(time_s)))

    def read_state(self, time_s: float) -> SensedState:
        """The delayed reading available at ``time_s``."""
        if self._taken_after == 0 or not self._readings:
            self._readings.append(self._add_noise(self._current_state(time_s)))
        return self._readings[0]

    def _current_state(self, time_s: float) -> SensedState:
        simulation = self._simulation
        contacts = {name: simulation.contact_placement(name) for name in simulation.built.geom}
        wrenches = simulation.effector_wrenches()
        forces = {name: wrench[:3] for name, wrench in wrenches.items()}
        moments = {name: w[3:] - cross(contacts[name].position_m, w[:3]) for name, w in wrenches.items()}
        return SensedState(time_s, *simulation.coordinates(), *simulation.com_state(), contacts, forces, moments)

    def _add_noise(self, state: SensedState) -> SensedState:
        noise = self._noise
        if noise is None:
            return state
        draw = self._rng.normal
        return replace(
            state,
            com_m=state.com_m + noise.position_m * draw(size=3),
            com_v_m_s=state.com_v_m_s + noise.velocity_m_s * draw(size=3),
            forces_n={name: f + noise.force_n * draw(size=3) for name, f in state.forces_n.items()},
            contacts={
                name: Placement(at.position_m + noise.position_m * draw(size=3), at.rotation)
                for name, at in state.contacts.items()
            },
        )
