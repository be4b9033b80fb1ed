"""What the contact floor knows of a robot's effectors: plain numbers, read without loading the robot itself."""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from stridelab.errors import NotFound
from stridelab.resources import models_dir

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
    """A sole (``surface``, with the half edges of its rectangle) or a hand (``point``); ``reach`` where learned."""

    kind: Literal["surface", "point"]
    half_size_m: tuple[float, float] | None = None
    reach: EffectorReach | None = None


@cache
def effector_shapes(robot_name: str) -> Mapping[str, EffectorShape]:
    """Effectors of a robot by name, from ``models/robots`` and, where it was learned, ``models/reachability``.

    Raises ``NotFound`` ("robot-not-found") for a name that has no file, naming those that have.
    """
    known = {path.stem: path for path in sorted((models_dir() / "robots").glob("*.toml"))}
    if robot_name not in known:
        names = ", ".join(known) or "none"
        raise NotFound("robot-not-found", f"there is no robot {robot_name!r}; known robots: {names}")
    card = tomllib.loads(known[robot_name].read_text(encoding="utf-8"))
    learned = _learned(models_dir() / "reachability" / known[robot_name].stem / "uniform.json")  # the widest measure
    return MappingProxyType({name: _shape(entry, learned.get(name)) for name, entry in card["effectors"].items()})


def _learned(path: Path) -> dict[str, EffectorReach]:
    if not path.is_file():
        return {}
    effectors = json.loads(path.read_text(encoding="utf-8"))["effectors"]
    return {name: _reach(entry["reach"]) for name, entry in effectors.items() if "reach" in entry}


def _reach(entry: Mapping[str, Any]) -> EffectorReach:
    low, high = (_triple(entry[key]) for key in ("com_low_m", "com_high_m"))
    return EffectorReach(low, high, float(entry["com_distance_max_m"]))


def _shape(entry: Mapping[str, Any], reach: EffectorReach | None) -> EffectorShape:
    if entry["kind"] == "point":
        return EffectorShape("point", None, reach)
    x, y = entry["contact_half_size_m"]
    return EffectorShape("surface", (float(x), float(y)), reach)


def _triple(values: Any) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
