"""Feasibility correction of the proxy: densities that weigh all feasible CoM positions equally.

The densities of section 4.3 count postures per CoM position; a position with few postures is still feasible. The
correction counts every feasible position once: for random contact sets the CoM is uniform over
the reachable positions, and the density of each effector is a mixture learned from those in its frame,

    f_i(x),  x = R_i^T (c - p_i),    (M_1 .. M_K, c) ~ U | a posture joins them,        f(c | M) ~ prod_i f_i

so that (4.12) and (4.13) apply unchanged with ``f_i`` instead of ``p_i``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError

from stridelab.conventions import Points, Series
from stridelab.errors import Fault, NotFound, UnreadableFile
from stridelab.machine.models_folder import models_dir
from stridelab.reachability.card import Matrix, Triple
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.kinematics.ik_ground_truth import ContactBatch
from stridelab.reachability.proxy.effector_proxy import Frame, Proxy
from stridelab.reachability.standing_conditions import axis_rotations
from stridelab.robots.card import robot_names

_STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)


@dataclass(frozen=True)
class FlatDensity:
    """One effector's mixture (metres, in ``frame``)."""

    __pydantic_config__ = _STRICT
    frame: Frame
    weights: tuple[float, ...]
    means: tuple[Triple, ...]
    covariances: tuple[Matrix, ...]

    def to_proxy(self) -> Proxy:
        """The density in its frame. Raises ``InvalidInput`` (``mixture-invalid``)."""
        return Proxy(Mixture(*(np.array(part) for part in (self.weights, self.means, self.covariances))), self.frame)


@dataclass(frozen=True)
class FeasibilityCard:
    """The correction of one robot: learned from ``pairs`` feasible pairs over ``stances`` random contact sets."""

    __pydantic_config__ = _STRICT
    robot: str
    robot_sha256: str
    seed: int
    stances: int
    pairs: int
    effectors: dict[str, FlatDensity]


def log_density(proxies: Mapping[str, Proxy], contacts: ContactBatch, com_m: Points) -> Series:
    """``sum_i log p_i(c)`` of (4.13), nats, for many contact sets with one CoM ``(n, 3)`` each."""
    total = np.zeros(len(com_m))
    for name in contacts.targets:
        local_m = com_in_frame(proxies[name].frame, contacts, name, com_m)
        total += proxies[name].mixture.log_density(local_m)
    return total


def com_in_frame(frame: Frame, contacts: ContactBatch, name: str, com_m: Points) -> Points:
    """The CoM in the frame of the effector ``name``; for a point, the heading frame in both cases."""
    p, R = contacts.targets[name]
    axes = axis_rotations(2, contacts.heading_rad) if R is None or frame == "heading" else R
    return np.asarray((axes.swapaxes(1, 2) @ (com_m - p)[..., None])[..., 0])


@cache
def load_feasibility(robot_name: str) -> Mapping[str, Proxy]:
    """The bundled correction of a robot, by effector.

    Raises ``NotFound`` (``robot-not-found``, ``reachability-not-learned``) and ``UnreadableFile``
    (``reachability-damaged``).
    """
    if robot_name not in robot_names():
        raise NotFound("robot-not-found", f"There is no robot {robot_name!r}; there is {', '.join(robot_names())}.")
    path = models_dir() / "feasibility" / f"{robot_name}.json"
    if not path.is_file():
        raise NotFound("reachability-not-learned", f"No feasibility correction has been learned for {robot_name!r}.")
    return MappingProxyType({name: flat.to_proxy() for name, flat in read_feasibility(path).effectors.items()})


def read_feasibility(path: Path) -> FeasibilityCard:
    """A card from a file. Raises ``UnreadableFile`` (``reachability-damaged``) naming every invalid field."""
    try:
        return TypeAdapter(FeasibilityCard).validate_json(path.read_bytes(), strict=True)
    except ValidationError as error:
        faults = [Fault(".".join(str(step) for step in item["loc"]), item["msg"]) for item in error.errors()]
        places = "; ".join(f"{fault.where}: {fault.message}" for fault in faults[:3])
        message = f"{path.name} is not a valid feasibility correction: {places}."
        raise UnreadableFile("reachability-damaged", message, faults) from error
