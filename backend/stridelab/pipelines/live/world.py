"""Changes the world of a running simulation: friction and softness of the terrain, and the payload."""

from typing import Final

import mujoco

from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box
from stridelab.schemas.live.messages import LiveSettings
from stridelab.wholebody.replay.simulation import Simulation

_DAMPING_RATIO: Final = 1.0
"""Of contacts with the terrain, as MuJoCo's default."""


class AdjustableWorld:
    """The terrain and the trunk of ``simulation``, as they are and as they were built.

    The softness is ``solref`` of the terrain, which has priority over that of soles and hands (MuJoCo's default is the
    same 20 ms for all). With priority, the friction of the terrain applies as well, as it does by default because
    soles and hands have none.
    """

    def __init__(self, simulation: Simulation, sequence: ContactSequence) -> None:
        self._simulation, self._model = simulation, simulation.built.model
        boxes = {surface.name for surface in sequence.terrain.surfaces if isinstance(surface, Box)}
        self._terrain = list(simulation.built.surface)
        self._boxes = [geom for geom, name in simulation.built.surface.items() if name in boxes]
        self._friction = self._model.geom_friction[self._boxes].copy()
        self._trunk_kg = float(self._model.body_mass[simulation.built.trunk])
        self._model.geom_priority[self._terrain] = 1

    def apply_settings(self, settings: LiveSettings) -> None:
        """Apply friction, payload and softness of the floor."""
        model, trunk = self._model, self._simulation.built.trunk
        model.geom_friction[self._boxes] = self._friction
        if settings.friction is not None:
            model.geom_friction[self._boxes, 0] = settings.friction
        model.geom_solref[self._terrain] = [settings.floor_time_s, _DAMPING_RATIO]
        mass_kg = self._trunk_kg + settings.payload_kg
        if model.body_mass[trunk] != mass_kg:
            model.body_mass[trunk] = mass_kg
            mujoco.mj_setConst(model, mujoco.MjData(model))
        self._simulation.refresh_derived()
