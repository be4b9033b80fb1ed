"""Geometry and reach of a robot's effectors as plain numbers, read without loading the robot model."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

from stridelab.conventions import Points
from stridelab.machine.models_folder import models_dir, robot_file
from stridelab.robots.card import EffectorCard, robot_card

Triple = tuple[float, float, float]
FOOT_CLEARANCE_M: Final = 0.06
"""Rise of a level sole in a swing without obstacles, for robots of the size of a person."""
HAND_RADIUS_M: Final = 0.02
"""Radius of a hand's contact sphere, whose surface passes through the contact point."""
CLEARANCE_PER_HEIGHT: Final = 0.11
"""Largest rise over the height of the CoM; it lowers the swings of robots whose CoM is below 0.55 m."""


@dataclass(frozen=True)
class EffectorReach:
    """Region of the CoM in the contact frame of one effector.

    A box from ``com_low_m`` to ``com_high_m`` (0.5 and 99.5 percentiles of the sampled postures), cut by a sphere of
    radius ``com_distance_max_m`` about the contact.
    """

    com_low_m: Triple
    com_high_m: Triple
    com_distance_max_m: float


@dataclass(frozen=True)
class EffectorShape:
    """A sole (``surface``, with the half edges of its rectangle) or a hand (``point``); ``reach`` if learned.

    ``com_height_m`` is the mean height of the CoM above a sole in the learned density of standing postures.
    """

    kind: Literal["surface", "point"]
    half_size_m: tuple[float, float] | None = None
    reach: EffectorReach | None = None
    com_height_m: float | None = None


def sole_points_m(half_size_m: tuple[float, float] | None) -> Points:
    """Corners, edge midpoints and centre of a sole ``(9, 3)`` in its contact frame; the origin if there is no size."""
    if half_size_m is None:
        return np.zeros((1, 3))
    x, y = half_size_m
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 0), (0, 1), (-1, 0), (0, -1), (0, 0)]
    return np.array([[i * x, j * y, 0.0] for i, j in signs])


def foot_clearance_m(com_height_m: float | None) -> float:
    """Rise of a level sole in a swing without obstacles, for a CoM at ``com_height_m``; None: not known."""
    return FOOT_CLEARANCE_M if com_height_m is None else min(FOOT_CLEARANCE_M, CLEARANCE_PER_HEIGHT * com_height_m)


@cache
def effector_shapes(robot_name: str) -> Mapping[str, EffectorShape]:
    """Effectors of a robot by name, from ``models/robots`` and, if available, ``models/reachability``.

    Raises ``NotFound`` (``robot-not-found``) for a name without a card, ``InvalidInput`` (``robot-card-invalid``).
    """
    card = robot_card(robot_name)
    folder = robot_file(models_dir(), "reachability", robot_name)
    uniform, conditioned = _learned_effectors(folder / "uniform.json"), _learned_effectors(folder / "conditioned.json")
    return MappingProxyType(
        {
            name: _effector_shape(entry, uniform.get(name), conditioned.get(name))
            for name, entry in card.effectors.items()
        }
    )


def stored_shapes(shapes: Mapping[str, Any]) -> Mapping[str, EffectorShape]:
    """Effectors from the JSON of ``plain_shapes``."""
    return MappingProxyType(
        {
            name: EffectorShape(
                shape["kind"],
                None if shape["half_size_m"] is None else (shape["half_size_m"][0], shape["half_size_m"][1]),
                None if shape["reach"] is None else _parse_reach(shape["reach"]),
                shape["com_height_m"],
            )
            for name, shape in shapes.items()
        }
    )


def plain_shapes(robot_name: str) -> dict[str, Any]:
    """The present ``effector_shapes`` of a robot as JSON. Raises as ``effector_shapes``."""
    effector_shapes.cache_clear()
    return {name: json.loads(json.dumps(asdict(shape))) for name, shape in effector_shapes(robot_name).items()}


def _learned_effectors(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    effectors: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["effectors"]
    return effectors


def _parse_reach(entry: Mapping[str, Any]) -> EffectorReach:
    low, high = (_parse_triple(entry[key]) for key in ("com_low_m", "com_high_m"))
    return EffectorReach(low, high, float(entry["com_distance_max_m"]))


def _effector_shape(effector: EffectorCard, uniform: Any, conditioned: Any) -> EffectorShape:
    reach = _parse_reach(uniform["reach"]) if uniform and "reach" in uniform else None
    sole = effector.kind == "surface" and conditioned
    height = float(np.dot(conditioned["weights"], np.array(conditioned["means"])[:, 2])) if sole else None
    return EffectorShape(effector.kind, effector.contact_half_size_m, reach, height)


def _parse_triple(values: Any) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
