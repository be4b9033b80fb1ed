"""Learned densities on disk: JSON text, ``models/reachability/<robot>.json`` for those that come with the package."""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

from pydantic import TypeAdapter, ValidationError

from stridelab.errors import Fault, InvalidInput, NotFound, UnreadableFile
from stridelab.reachability.card import EffectorCard, ReachabilityCard
from stridelab.reachability.mixture import Mixture
from stridelab.resources import models_dir
from stridelab.robots.card import robot_names

_NUMBERS: Final = re.compile(r"\[\s+([-+\d.e,\s]+?)\s+\]")
"""A list of numbers that was spread over lines."""


def load_proxies(robot_name: str) -> Mapping[str, Mixture]:
    """The bundled density of every effector of a robot, of the CoM in the effector's contact frame.

    Raises as ``load_card``.
    """
    return MappingProxyType({name: effector.mixture() for name, effector in load_card(robot_name).effectors.items()})


@cache
def load_card(robot_name: str) -> ReachabilityCard:
    """The bundled card of a robot.

    Raises ``NotFound`` (``robot-not-found``; ``reachability-not-learned`` where no file is there) and
    ``UnreadableFile`` (``reachability-damaged``).
    """
    if robot_name not in robot_names():
        raise NotFound("robot-not-found", f"There is no robot {robot_name!r}; there is {', '.join(robot_names())}.")
    path = models_dir() / "reachability" / f"{robot_name}.json"
    if not path.is_file():
        raise NotFound("reachability-not-learned", f"No reachability densities were learned for {robot_name!r} yet.")
    card = read(path)
    if card.robot != robot_name:
        raise _damaged(path, [Fault("robot", f"the file is about {card.robot!r}")])
    return card


def read(path: Path) -> ReachabilityCard:
    """A card from a file. Raises ``UnreadableFile`` (``reachability-damaged``) naming the file and every bad place."""
    try:
        # JSON is strict about types, and still takes a list for a tuple
        card = TypeAdapter(ReachabilityCard).validate_json(path.read_bytes(), strict=True)
    except ValidationError as error:
        faults = [Fault(_where(item["loc"]), item["msg"]) for item in error.errors()]
        raise _damaged(path, faults) from error
    except OSError as error:
        raise _damaged(path, [Fault("", "it cannot be read")]) from error
    faults = [fault for name, effector in card.effectors.items() for fault in _faults(f"effectors.{name}", effector)]
    if faults:
        raise _damaged(path, faults)
    return card


def save(path: Path, card: ReachabilityCard) -> None:
    """Write a card; ``read`` gives the same one back, to the last bit."""
    path.write_text(text(card), encoding="utf-8")


def text(card: ReachabilityCard) -> str:
    """The card as JSON, every vector on one line."""
    spread = json.dumps(asdict(card), indent=1, ensure_ascii=False, allow_nan=False)
    return _NUMBERS.sub(lambda found: "[" + re.sub(r"\s+", " ", found[1]) + "]", spread) + "\n"


def _faults(where: str, effector: EffectorCard) -> list[Fault]:
    """What the types do not say."""
    k = effector.components
    counts = {name: len(getattr(effector, name)) for name in ("weights", "means", "covariances")}
    wrong = [Fault(f"{where}.{name}", f"there are {n} for {k} components") for name, n in counts.items() if n != k]
    if k < 1 or wrong:
        return [*wrong, *([Fault(f"{where}.components", "there are none")] if k < 1 else [])]
    try:
        effector.mixture()
    except InvalidInput as error:
        return [Fault(f"{where}.{fault.where}", fault.message) for fault in error.faults]
    return []


def _damaged(path: Path, faults: list[Fault]) -> UnreadableFile:
    places = "; ".join(f"{fault.where}: {fault.message}" if fault.where else fault.message for fault in faults[:3])
    more = f" and {len(faults) - 3} more" if len(faults) > 3 else ""
    return UnreadableFile(
        "reachability-damaged", f"{path.parent.name}/{path.name} holds no learned densities: {places}{more}.", faults
    )


def _where(location: tuple[int | str, ...]) -> str:
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in location)
    return "".join(steps).removeprefix(".")
