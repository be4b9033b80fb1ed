"""Saved states of a stepper, to which a live session can return.

Control, recovery, clock and sensors are pickled. Objects that do not change, or are recomputed from the measured state
at every sample (pinocchio's workspaces), are shared by all states.
"""

import io
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.contacts.sequence import ContactSequence
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.collision_avoidance import CollisionAvoidance
from stridelab.wholebody.control.rigid_body import RigidBody
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.recovery.footholds import Footholds
from stridelab.wholebody.recovery.leg_geometry import LegGeometry
from stridelab.wholebody.replay.capturability import Capturability
from stridelab.wholebody.replay.log import ReplayLog
from stridelab.wholebody.replay.replay import PhysicsReplay
from stridelab.wholebody.replay.simulation import Simulation
from stridelab.wholebody.replay.stepper import ReplayStepper

_SHARED: Final = (
    *(Robot, ContactSequence, WholeBodyMotion, Capturability, Simulation, LegGeometry, PhysicsReplay, Footholds),
    *(LimbKinematics, RigidBody, CollisionAvoidance, pin.Model, pin.Data, ReplayLog),
)


@dataclass(frozen=True, eq=False)
class SavedState:
    """A state of a stepper at ``time_s``; ``shared`` are the objects that it refers to, by number."""

    time_s: float
    control: bytes
    shared: dict[int, Any]
    world: Float[np.ndarray, "k"]


class _Saver(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: dict[int, Any]) -> None:
        super().__init__(file, protocol=5)
        self._shared = shared

    def persistent_id(self, obj: Any) -> int | None:
        if not isinstance(obj, _SHARED):
            return None
        self._shared[id(obj)] = obj
        return id(obj)


class _Loader(pickle.Unpickler):
    """Reads what this process has pickled."""

    persistent_load: Callable[[int], Any]

    def __init__(self, state: SavedState) -> None:
        super().__init__(io.BytesIO(state.control))
        self.persistent_load = state.shared.__getitem__


def save_state(stepper: ReplayStepper) -> SavedState:
    """The present state of ``stepper``."""
    file, shared = io.BytesIO(), dict[int, Any]()
    _Saver(file, shared).dump(vars(stepper))
    return SavedState(stepper.time_s, file.getvalue(), shared, stepper.simulation.save_state())


def restore_state(stepper: ReplayStepper, state: SavedState) -> None:
    """Return to ``state``, as often as needed. The log goes on as it is."""
    vars(stepper).update(_Loader(state).load())
    stepper.simulation.restore_state(state.world)
