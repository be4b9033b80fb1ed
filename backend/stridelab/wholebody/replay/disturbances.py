"""Disturbances of a replay: deviations of world and robot from the plan.

They are unknown to the plan, to the feed-forward torques and to the stabiliser.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, InvalidInput


@dataclass(frozen=True)
class Push:
    """A constant force at the centre of mass of ``link``: ``impulse_ns`` (world axes) over ``duration_s``.

    It starts ``time_s`` after the start of the replay. None is the trunk. With ``at_joint``, the force acts at the
    joint that moves the link, instead of at its centre of mass.
    """

    time_s: float
    impulse_ns: tuple[float, float, float]
    duration_s: float = 0.1
    link: str | None = None
    at_joint: bool = False

    @property
    def end_s(self) -> float:
        """Time at which the force ends."""
        return self.time_s + self.duration_s

    def force_n(self, time_s: float) -> Vector3:
        """Force (N, world axes) at one time."""
        acts = self.time_s <= time_s < self.time_s + self.duration_s
        return np.array(self.impulse_ns) / self.duration_s * float(acts)


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise on the stabiliser's inputs: positions, CoM velocity, forces."""

    position_m: float = 0.001
    velocity_m_s: float = 0.01
    force_n: float = 2.0


@dataclass(frozen=True)
class Disturbances:
    """All disturbances of one replay; the defaults disturb nothing.

    ``friction`` replaces that of all boxes. ``sole_half_size_m`` are the half edges of the simulated soles.
    ``torque_noise`` is the standard deviation of a factor about one, drawn independently for every joint and step.
    ``terrain_up_m`` raises every box except those under the first contacts, ``rail_shift_m`` moves the rails.
    ``delay_s`` delays the stabiliser's inputs, and ``joint_delay_s`` the joint angles and rates that the joint control
    uses, both rounded to the nearest step of the simulator. ``trunk_mass_kg`` is added to the trunk, at its centre of
    mass.

    Raises ``InvalidInput`` (``disturbance-out-of-range``).
    """

    friction: float | None = None
    sole_half_size_m: tuple[float, float] | None = None
    torque_noise: float = 0.0
    terrain_up_m: float = 0.0
    rail_shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    delay_s: float = 0.0
    joint_delay_s: float = 0.0
    trunk_mass_kg: float = 0.0
    pushes: tuple[Push, ...] = ()
    sensor_noise: SensorNoise | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        positive = {"friction": self.friction, "sole_half_size_m": min(self.sole_half_size_m or (1.0,))}
        faults = [Fault(name, f"must be positive, not {v}") for name, v in positive.items() if v is not None and v <= 0]
        counted = {name: getattr(self, name) for name in ("torque_noise", "delay_s", "joint_delay_s")}
        faults += [Fault(name, f"must not be negative, is {v}") for name, v in counted.items() if not v >= 0.0]
        if faults:
            raise InvalidInput("disturbance-out-of-range", "Some disturbances are out of range.", faults)

    def disturbed_terrain(self, sequence: ContactSequence) -> Terrain:
        """The disturbed terrain of a sequence."""
        start_surfaces = {contact.surface for contact in sequence.phases[0].contacts.values()}
        surfaces: list[Box | Rail] = []
        for surface in sequence.terrain.surfaces:
            if isinstance(surface, Rail):
                shift = np.array(self.rail_shift_m)
                surfaces.append(replace(surface, from_m=surface.from_m + shift, to_m=surface.to_m + shift))
                continue
            up_m = 0.0 if surface.name in start_surfaces else self.terrain_up_m
            planned = surface.placement
            placement = Placement(planned.position_m + np.array([0.0, 0.0, up_m]), planned.rotation)
            friction = surface.friction if self.friction is None else self.friction
            surfaces.append(replace(surface, placement=placement, friction=friction))
        return Terrain.from_surfaces(surfaces)


UNDISTURBED: Final = Disturbances()
