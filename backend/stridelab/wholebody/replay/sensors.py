"""Simulated sensors of the replay control, with noise and delay.

``Observe`` is the interface of a state estimator: it maps the sensed state to the state that the stabiliser uses. The
default is the identity.
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
class Seen:
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


Observe = Callable[[Seen], Seen]


def as_sensed(seen: Seen) -> Seen:
    """Identity observer: no estimator."""
    return seen


class Sensors:
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
        self._late: deque[Seen] = deque(maxlen=size)

    def step(self, done: int, time_s: float) -> None:
        """Call after every step; ``done`` is the number of steps since the last call of ``read_state``."""
        if self._taken_after and done == self._taken_after:
            self._simulation.refresh()
            self._late.append(self._noisy(self._now(time_s)))

    def read(self, time_s: float) -> Seen:
        """The delayed reading available at ``time_s``."""
        if self._taken_after == 0 or not self._late:
            self._late.append(self._noisy(self._now(time_s)))
        return self._late[0]

    def _now(self, time_s: float) -> Seen:
        simulation = self._simulation
        contacts = {name: simulation.contact(name) for name in simulation.built.geom}
        wrenches = simulation.wrenches()
        forces = {name: wrench[:3] for name, wrench in wrenches.items()}
        moments = {name: w[3:] - cross(contacts[name].position_m, w[:3]) for name, w in wrenches.items()}
        return Seen(time_s, *simulation.coordinates(), *simulation.com(), contacts, forces, moments)

    def _noisy(self, seen: Seen) -> Seen:
        noise = self._noise
        if noise is None:
            return seen
        draw = self._rng.normal
        return replace(
            seen,
            com_m=seen.com_m + noise.position_m * draw(size=3),
            com_v_m_s=seen.com_v_m_s + noise.velocity_m_s * draw(size=3),
            forces_n={name: f + noise.force_n * draw(size=3) for name, f in seen.forces_n.items()},
            contacts={
                name: Placement(at.position_m + noise.position_m * draw(size=3), at.rotation)
                for name, at in seen.contacts.items()
            },
        )
