"""What the contact floor knows of a robot's effectors: plain numbers, read without loading the robot itself."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from stridelab.conventions import Points
from stridelab.resources import models_dir
from stridelab.robots.card import EffectorCard, robot_card

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class EffectorReach:
    """Where the CoM can be, seen from the contact frame of one effector.

    A box from ``com_low_m`` to ``com_high_m`` (0.5 and 99.5 percentiles of the sampled postures), cut by a sphere of
    radius ``com_distance_max_m`` about the contact.
    """

    com_low_m: Triple
    com_high_m: Triple
    com_distance_max_m: float


@dataclass(frozen=True)
class EffectorShape:
    """A sole (``surface``, with the half edges of its rectangle) or a hand (``point``); ``reach`` where learned.

    ``com_height_m`` is the mean height of the CoM above a sole, learned of the robot as it stands.
    """

    kind: Literal["surface", "point"]
    half_size_m: tuple[float, float] | None = None
    reach: EffectorReach | None = None
    com_height_m: float | None = None


def patch_m(half_size_m: tuple[float, float] | None) -> Points:
    """Corners, middles of the edges and centre of a sole ``(9, 3)`` in its contact frame; its origin without a size."""
    if half_size_m is None:
        return np.zeros((1, 3))
    x, y = half_size_m
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 0), (0, 1), (-1, 0), (0, -1), (0, 0)]
    return np.array([[i * x, j * y, 0.0] for i, j in signs])


@cache
def effector_shapes(robot_name: str) -> Mapping[str, EffectorShape]:
    """Effectors of a robot by name, from ``models/robots`` and, where it was learned, ``models/reachability``.

    Raises ``NotFound`` (``robot-not-found``) for a name that has no card, naming those that have, ``InvalidInput``
    (``robot-card-invalid``).
    """
    card = robot_card(robot_name)
    folder = models_dir() / "reachability" / robot_name
    wide, standing = _learned(folder / "uniform.json"), _learned(folder / "conditioned.json")
    return MappingProxyType(
        {name: _shape(entry, wide.get(name), standing.get(name)) for name, entry in card.effectors.items()}
    )


def _learned(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    effectors: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["effectors"]
    return effectors


def _reach(entry: Mapping[str, Any]) -> EffectorReach:
    low, high = (_triple(entry[key]) for key in ("com_low_m", "com_high_m"))
    return EffectorReach(low, high, float(entry["com_distance_max_m"]))


def _shape(effector: EffectorCard, wide: Any, standing: Any) -> EffectorShape:
    reach = _reach(wide["reach"]) if wide and "reach" in wide else None
    sole = effector.kind == "surface" and standing
    height = float(np.dot(standing["weights"], np.array(standing["means"])[:, 2])) if sole else None
    return EffectorShape(effector.kind, effector.contact_half_size_m, reach, height)


def _triple(values: Any) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
