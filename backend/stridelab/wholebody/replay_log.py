"""What is measured while a motion is replayed."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import Vector3
from stridelab.robots.robot import Robot
from stridelab.wholebody.simulation import Simulation

TOUCHING_N: Final = 5.0
"""Force from which an effector counts as loaded."""


@dataclass(frozen=True, eq=False)
class Replay:
    """What happened. ``q``, ``v`` are in the order of the motion; ``forces_n`` the world-frame force per effector.

    Errors are those of the simulated CoM against the plan's. ``foot_slip_max_m`` is the largest displacement of a
    loaded sole since its touch-down, ``landing_error_max_m`` the largest distance from the planned place there.
    ``hand_contact_share`` is the part of the planned hand contacts in which the hand is loaded.
    """

    time_s: Float[np.ndarray, "n"]
    q: Float[np.ndarray, "n nq"]
    v: Float[np.ndarray, "n nv"]
    com_m: Float[np.ndarray, "n 3"]
    forces_n: Mapping[str, Float[np.ndarray, "n 3"]]
    completed: bool
    fall_time_s: float | None
    com_error_rms_m: float
    com_error_max_m: float
    foot_slip_max_m: float
    landing_error_max_m: float
    hand_force_mean_n: float | None
    hand_contact_share: float | None
    torque_ratio_max: float
    real_time_factor: float


class ReplayLog:
    """Collects samples; a touch-down is the first loaded sample of a planned contact."""

    def __init__(self, robot: Robot, sequence: ContactSequence) -> None:
        self._robot, self._sequence = robot, sequence
        self._time_s: list[float] = []
        self._q: list[Float[np.ndarray, "nq"]] = []
        self._v: list[Float[np.ndarray, "nv"]] = []
        self._com_m: list[Vector3] = []
        self._errors_m: list[float] = []
        self._forces_n: dict[str, list[Vector3]] = {name: [] for name in sequence.effectors}
        self._landed: dict[str, Vector3] = {}
        self._slips_m, self._landings_m = [0.0], [0.0]
        self._hand_n: list[float] = []

    def sample(self, simulation: Simulation, time_s: float, plan_time_s: float, com_m: Vector3, error_m: float) -> None:
        """Take the state after the step that ends at ``time_s``, when the plan has come to ``plan_time_s``."""
        q, v = simulation.coordinates()
        self._time_s.append(time_s)
        self._q.append(q)
        self._v.append(v)
        self._com_m.append(com_m)
        self._errors_m.append(error_m)
        forces = simulation.forces_n()
        planned = self._sequence.phases[self._sequence.phase_at(plan_time_s)].contacts
        for name, force in forces.items():
            self._forces_n[name].append(force)
            if self._robot.effectors[name].kind == "surface":
                self._follow(simulation, name, planned.get(name), float(np.linalg.norm(force)))
            elif name in planned:
                self._hand_n.append(float(np.linalg.norm(force)))

    def _follow(self, simulation: Simulation, name: str, planned: Contact | None, force_n: float) -> None:
        if planned is None:
            self._landed.pop(name, None)
        elif force_n > TOUCHING_N:
            here = simulation.contact(name).position_m
            if name not in self._landed:
                self._landed[name] = here
                self._landings_m.append(float(np.linalg.norm(here - planned.placement.position_m)))
            self._slips_m.append(float(np.linalg.norm(here - self._landed[name])))

    def replay(self, completed: bool, torque_ratio_max: float, took_s: float) -> Replay:
        """All of it."""
        errors = np.array(self._errors_m)
        hand = np.array(self._hand_n)
        return Replay(
            time_s=np.array(self._time_s),
            q=np.array(self._q),
            v=np.array(self._v),
            com_m=np.array(self._com_m),
            forces_n={name: np.array(forces) for name, forces in self._forces_n.items()},
            completed=completed,
            fall_time_s=None if completed else self._time_s[-1],
            com_error_rms_m=float(np.sqrt(np.mean(errors**2))),
            com_error_max_m=float(errors.max()),
            foot_slip_max_m=max(self._slips_m),
            landing_error_max_m=max(self._landings_m),
            hand_force_mean_n=float(hand.mean()) if len(hand) else None,
            hand_contact_share=float(np.mean(hand > TOUCHING_N)) if len(hand) else None,
            torque_ratio_max=torque_ratio_max,
            real_time_factor=self._time_s[-1] / took_s,
        )
