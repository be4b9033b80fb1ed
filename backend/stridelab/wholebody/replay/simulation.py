"""A running simulation in the robot's own coordinates."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement, cross
from stridelab.wholebody.replay.mujoco_model import SimulationModel


class GeomContact(NamedTuple):
    """Two geometries in contact, by index, and the norm of the force between them (N).

    ``sole`` is the effector whose sole touches the terrain with its flat patch beside the contact rectangle.
    """

    first: int
    second: int
    force_n: float
    sole: str = ""


class Simulation:
    """State of one simulated robot; coordinates in pinocchio's order (base velocity in the base frame).

    ``body_contacts`` are the contacts of the collision shapes in the last step. Those of flat patches of soles on their
    surfaces belong to planned contacts, all others are never planned.
    ``strained_joint`` is the index of the moving joint with the largest torque command over its limit in that step.
    """

    def __init__(self, built: SimulationModel, q: Float[np.ndarray, "nq"]) -> None:
        self.built = built
        self._model = built.model
        self._data = mujoco.MjData(built.model)
        self._is_body = np.zeros(built.model.ngeom, dtype=bool)
        self._is_body[list(built.link)] = True
        self.body_contacts: tuple[GeomContact, ...] = ()
        self.strained_joint = 0
        self._measured: tuple[dict[str, Float[np.ndarray, "6"]], tuple[GeomContact, ...]] | None = None
        self._root = 1  # the robot's first body; 0 is the world
        self._command_nm = np.zeros(built.model.nu)
        self._least_nm = -built.torque_limit_nm
        self._moving_limit_nm = built.torque_limit_nm[built.moving_actuator]
        self._coordinates: tuple[Float[np.ndarray, "nq"], Float[np.ndarray, "nv"]] | None = None
        self._placements: dict[str, Placement] = {}
        self._com_state: tuple[Vector3, Vector3] | None = None
        x, y, z, w = q[3:7]
        self._data.qpos[:7] = [*q[:3], w, x, y, z]
        self._data.qpos[built.moving_qpos] = q[7:]
        self._data.qpos[built.locked_qpos] = built.locked_rad
        mujoco.mj_forward(self._model, self._data)
        self._refreshed = True

    @property
    def mass_kg(self) -> float:
        """Mass of the simulated robot."""
        return float(self._model.body_subtreemass[self._root])

    @property
    def timestep_s(self) -> float:
        """Length of one step."""
        return float(self._model.opt.timestep)

    @property
    def joints_rad(self) -> Float[np.ndarray, "na"]:
        """Angles of the moving joints."""
        return np.asarray(self._data.qpos[self.built.moving_qpos])

    @property
    def joint_rates_rad_s(self) -> Float[np.ndarray, "na"]:
        """Rates of the moving joints."""
        return np.asarray(self._data.qvel[self.built.moving_dof])

    def locked_torques_nm(
        self, stiffness: Float[np.ndarray, "nl"], damping: Float[np.ndarray, "nl"]
    ) -> Float[np.ndarray, "nl"]:
        """Torques that hold the locked joints at their angles."""
        built, data = self.built, self._data
        off = built.locked_rad - data.qpos[built.locked_qpos]
        return np.asarray(stiffness * off - damping * data.qvel[built.locked_dof])

    def step(self, moving_nm: Float[np.ndarray, "na"], locked_nm: Float[np.ndarray, "nl"]) -> float:
        """One step under torques clipped at the limits; returns the largest ratio of commanded torque and limit."""
        u, built = self._command_nm, self.built
        u[built.moving_actuator] = moving_nm
        u[built.locked_actuator] = locked_nm
        np.minimum(np.maximum(u, self._least_nm), built.torque_limit_nm, out=self._data.ctrl)
        if self._refreshed:  # derived quantities and contacts are already up to date
            mujoco.mj_step2(self._model, self._data)
        else:
            mujoco.mj_step(self._model, self._data)
        self._forget_measurements(refreshed=False)
        is_body = self._is_body[self._data.contact.geom[: self._data.ncon]]
        touching = np.flatnonzero(is_body.any(axis=1)).tolist() if is_body.any() else ()
        self.body_contacts = tuple(map(self._geom_contact, touching))
        ratios = np.abs(moving_nm) / self._moving_limit_nm
        self.strained_joint = int(ratios.argmax())
        return float(ratios[self.strained_joint])

    def apply_forces(self, forces: Sequence[tuple[int, Vector3]], at_joint: Sequence[bool] = ()) -> None:
        """Set the forces (N, world axes) at the centres of mass of bodies for the following steps; those of one add.

        Where ``at_joint`` is true, the force acts at the origin of the body, which is the joint that moves it.
        """
        data = self._data
        for body, _ in forces:
            data.xfrc_applied[body] = 0.0
        for (body, force_n), is_at_joint in zip(forces, at_joint or [False] * len(forces), strict=True):
            data.xfrc_applied[body, :3] += force_n
            if is_at_joint:
                data.xfrc_applied[body, 3:] += cross(data.xpos[body] - data.xipos[body], force_n)

    def refresh_derived(self) -> None:
        """Update all derived quantities to the coordinates after the last step.

        A step ends with the integration; without a refresh, derived quantities are those before it.
        """
        mujoco.mj_forward(self._model, self._data)
        self._forget_measurements(refreshed=True)

    def save_state(self) -> Float[np.ndarray, "k"]:
        """Everything that the next steps depend on, apart from the model, as one array."""
        spec = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self._model, spec))
        mujoco.mj_getState(self._model, self._data, state, spec)
        return state

    def restore_state(self, state: Float[np.ndarray, "k"]) -> None:
        """Return to a state of ``save_state``."""
        mujoco.mj_setState(self._model, self._data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.body_contacts = ()
        self.refresh_derived()

    def com_state(self) -> tuple[Vector3, Vector3]:
        """Position (m) and velocity (m/s) of the centre of mass."""
        if self._com_state is None:
            mujoco.mj_subtreeVel(self._model, self._data)
            data, root = self._data, self._root
            self._com_state = np.array(data.subtree_com[root]), np.array(data.subtree_linvel[root])
        return self._com_state

    def coordinates(self) -> tuple[Float[np.ndarray, "nq"], Float[np.ndarray, "nv"]]:
        """``q`` and ``v`` of the robot's reduced model."""
        if self._coordinates is None:
            d = self._data
            w, x, y, z = d.qpos[3:7]
            R = d.xmat[self._root].reshape(3, 3)
            q = np.concatenate([d.qpos[:3], [x, y, z, w], self.joints_rad])
            self._coordinates = q, np.concatenate([R.T @ d.qvel[:3], d.qvel[3:6], self.joint_rates_rad_s])
        return self._coordinates

    def contact_placement(self, effector: str) -> Placement:
        """Placement of an effector's contact frame."""
        if effector not in self._placements:
            body = self.built.body[effector]
            T_world_body = Placement(np.array(self._data.xpos[body]), self._data.xmat[body].reshape(3, 3).copy())
            self._placements[effector] = T_world_body @ self.built.T_body_contact[effector]
        return self._placements[effector]

    def forces_n(self) -> dict[str, Vector3]:
        """World-frame force of the environment on every effector."""
        return {name: wrench[:3] for name, wrench in self.effector_wrenches().items()}

    def effector_wrenches(self) -> Mapping[str, Float[np.ndarray, "6"]]:
        """Force and moment about the world origin of the environment on every effector, in world axes."""
        return self._effector_measurements()[0]

    def effector_contacts(self) -> tuple[GeomContact, ...]:
        """Contacts of the soles' boxes and the hands' spheres, which are first in each pair."""
        return self._effector_measurements()[1]

    def _effector_measurements(self) -> tuple[dict[str, Float[np.ndarray, "6"]], tuple[GeomContact, ...]]:
        """Wrenches and contacts of the effectors, computed once per state."""
        if self._measured is None:
            wrenches = {name: np.zeros(6) for name in self.built.geom}
            local, contacts = np.zeros(6), []
            at, effectors = self._data.contact, self.built.effector
            pairs, frames, points_m = at.geom[: self._data.ncon].tolist(), at.frame, at.pos
            for k, (first, second) in enumerate(pairs):
                for geom, other, sign in ((second, first, 1.0), (first, second, -1.0)):
                    if geom in effectors:
                        # the force is in the contact frame, whose rows are its axes, and acts on the second geometry
                        mujoco.mj_contactForce(self._model, self._data, k, local)
                        axes, wrench = sign * frames[k].reshape(3, 3).T, wrenches[effectors[geom]]
                        force = axes @ local[:3]
                        wrench[:3] += force
                        wrench[3:] += axes @ local[3:] + cross(points_m[k], force)
                        contacts.append(GeomContact(geom, other, math.sqrt(float(force @ force))))
            self._measured = wrenches, tuple(contacts)
        return self._measured

    def _forget_measurements(self, *, refreshed: bool) -> None:
        """The state has changed; whether derived quantities are ``refreshed`` already."""
        self._measured, self._coordinates, self._com_state, self._refreshed = None, None, None, refreshed
        self._placements.clear()

    def _geom_contact(self, k: int) -> GeomContact:
        """Contact k of the last step."""
        local = np.zeros(6)
        mujoco.mj_contactForce(self._model, self._data, k, local)
        first, second = self._data.contact.geom[k].tolist()
        return GeomContact(first, second, float(np.linalg.norm(local[:3])), self._sole_of(k, first, second))

    def _sole_of(self, k: int, first: int, second: int) -> str:
        """The effector whose flat patch touches the terrain in contact k, or none."""
        patch = self.built.patch.get(first) or self.built.patch.get(second)
        if patch is None or not (first in self.built.surface or second in self.built.surface):
            return ""
        T, contact = self.contact_placement(patch.effector), self._data.contact
        point_m = T.rotation.T @ (contact.pos[k] - T.position_m)
        return patch.effector if patch.contains_contact(point_m, T.rotation.T @ contact.frame[k][:3]) else ""
