"""Learned densities on disk: one folder per robot, one card and one cloud per measure.

    models/reachability/<robot>/<measure>.json      the card with its mixtures, as text
    models/reachability/<robot>/<measure>.npz       the first samples of every effector, whole millimetres

Reading executes no code, and errors name the damaged file.
"""

import json
import re
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from datetime import date
from functools import cache
from pathlib import Path
from tokenize import TokenError
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, get_args

import numpy as np
from pydantic import TypeAdapter, ValidationError

from stridelab.conventions import Points
from stridelab.errors import Fault, InvalidInput, NotFound, Unavailable, UnreadableFile
from stridelab.machine.models_folder import models_dir, robot_file
from stridelab.reachability.card import EffectorCard, Measure, ReachabilityCard
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.card import field_path, robot_names

if TYPE_CHECKING:
    import stridelab.robots.robot

DEFAULT_MEASURE: Final[Measure] = "conditioned"
"""Default measure of plans."""
CLOUD_SAMPLES: Final = 5000
"""Number of samples of a cloud that are stored."""
UNIT_M: Final = 1e-3
"""Resolution of stored samples, much smaller than the kernel width."""
CLOUD_BYTES_MAX: Final = 1 << 20
"""Maximum size of an array of a cloud; larger ones are not unpacked."""
_UNREADABLE: Final = (
    OSError, ValueError, EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error,
    SyntaxError, TokenError,
)  # fmt: skip
"""Exceptions of a damaged archive; the last two because numpy parses array headers as Python text."""
_NUMBERS: Final = re.compile(r"\[\s+([-+\d.e,\s]+?)\s+\]")
"""A list of numbers over several lines."""


def load_proxies(robot_name: str, measure: Measure = DEFAULT_MEASURE) -> Mapping[str, Proxy]:
    """The bundled densities of the CoM in the frames of a robot's effectors.

    Raises as ``load_card``.
    """
    effectors = load_card(robot_name, measure).effectors
    return MappingProxyType({name: effector.to_proxy() for name, effector in effectors.items()})


@cache
def load_card(robot_name: str, measure: Measure = DEFAULT_MEASURE) -> ReachabilityCard:
    """The bundled card of a robot.

    Raises ``NotFound`` (``robot-not-found``; ``reachability-not-learned`` if there is no file), ``InvalidInput``
    (``measure-unknown``) and ``UnreadableFile`` (``reachability-damaged``).
    """
    path = _bundled_path(robot_name, measure, ".json")
    card = read_card(path)
    for field, expected in (("robot", robot_name), ("measure", measure)):
        if (value := getattr(card, field)) != expected:
            raise _damaged_file(path, [Fault(field, f"the file contains {value!r}")])
    return card


def load_cloud(robot_name: str, measure: Measure = DEFAULT_MEASURE) -> Mapping[str, Points]:
    """The first ``CLOUD_SAMPLES`` of the samples ``(n, 3)`` that a bundled card was learned from, rounded to 1 mm.

    Raises as ``load_card``.
    """
    path = _bundled_path(robot_name, measure, ".npz")
    cloud = read_cloud(path)
    if cloud.keys() != (expected := load_card(robot_name, measure).effectors.keys()):
        message = f"it has samples of {', '.join(sorted(cloud))}, the card of {', '.join(sorted(expected))}"
        raise _damaged_file(path, [Fault("effectors", message)])
    return cloud


def require_same_robot(card: ReachabilityCard, robot: "stridelab.robots.robot.Robot") -> None:
    """Raise ``Unavailable`` (``reachability-of-another-robot``) unless the card was learned from this description."""
    if card.robot_sha256 != robot.sha256:
        raise Unavailable(
            "reachability-of-another-robot",
            f"The {card.measure} reachability densities of {robot.title} were learned from a description of the "
            f"robot other than the installed one; learn them again (learn-reachability).",
            [Fault("robot_sha256", f"learned on {card.robot_sha256[:12]}, installed is {robot.sha256[:12]}")],
        )


def read_card(path: Path) -> ReachabilityCard:
    """A card from a file. Raises ``UnreadableFile`` (``reachability-damaged``) naming file and invalid fields."""
    try:
        # JSON is strict about types, and still takes a list for a tuple
        card = TypeAdapter(ReachabilityCard).validate_json(path.read_bytes(), strict=True)
    except ValidationError as error:
        faults = [Fault(field_path(item["loc"]), item["msg"]) for item in error.errors()]
        raise _damaged_file(path, faults) from error
    except OSError as error:
        raise _damaged_file(path, [Fault("", "it cannot be read")]) from error
    faults = [
        fault for name, effector in card.effectors.items() for fault in _effector_faults(f"effectors.{name}", effector)
    ]
    try:
        date.fromisoformat(card.learned_on)
    except ValueError:
        faults.append(Fault("learned_on", f"{card.learned_on!r} is not a date"))
    if faults:
        raise _damaged_file(path, faults)
    return card


def save_card(path: Path, card: ReachabilityCard) -> None:
    """Write a card; ``read_card`` restores it bit for bit."""
    path.write_text(card_json(card), encoding="utf-8")


def card_json(card: ReachabilityCard) -> str:
    """The card as JSON, every vector on one line."""
    spread = json.dumps(asdict(card), indent=1, ensure_ascii=False, allow_nan=False)
    return _NUMBERS.sub(lambda match: "[" + re.sub(r"\s+", " ", match[1]) + "]", spread) + "\n"


def read_cloud(path: Path) -> Mapping[str, Points]:
    """A cloud from a file. Raises ``UnreadableFile`` (``reachability-damaged``) naming the file and the effector."""
    cloud: dict[str, Points] = {}
    try:
        with zipfile.ZipFile(path) as packed:
            large = [member.filename for member in packed.infolist() if member.file_size > CLOUD_BYTES_MAX]
            if large:
                raise _damaged_file(path, [Fault(name, "it is too large") for name in large])
            if (spoilt := packed.testzip()) is not None:
                raise _damaged_file(path, [Fault(spoilt, "its checksum is wrong")])
        with np.load(path, allow_pickle=False) as arrays:
            for name in arrays.files:
                values = arrays[name]
                if values.dtype != np.int16 or values.ndim != 2 or values.shape[1:] != (3,) or not len(values):
                    raise _damaged_file(path, [Fault(name, f"it is {values.dtype} of shape {values.shape}")])
                cloud[name] = values * UNIT_M
    except _UNREADABLE as error:
        raise _damaged_file(path, [Fault("", "it is not an archive of plain arrays")]) from error
    return MappingProxyType(cloud)


def save_cloud(path: Path, com_m: Mapping[str, Points]) -> None:
    """Write the first ``CLOUD_SAMPLES`` of every effector (m, within 32 m), as the same bytes for the same samples."""
    whole = {name: np.rint(x[:CLOUD_SAMPLES] / UNIT_M).astype(np.int16) for name, x in com_m.items()}
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **whole)


def _bundled_path(robot_name: str, measure: str, suffix: str) -> Path:
    """Path of a bundled file; checks the names of robot and measure."""
    if robot_name not in robot_names():
        raise NotFound("robot-not-found", f"There is no robot {robot_name!r}; there is {', '.join(robot_names())}.")
    if measure not in (measures := get_args(Measure)):
        message = f"There is no measure {measure!r}; there is {', '.join(measures)}."
        raise InvalidInput("measure-unknown", message, [Fault("measure", "unknown")])
    path = robot_file(models_dir(), "reachability", robot_name, f"{measure}{suffix}")
    if not path.is_file():
        message = f"No {measure} reachability densities have been learned for {robot_name!r}."
        raise NotFound("reachability-not-learned", message)
    return path


def _effector_faults(where: str, effector: EffectorCard) -> list[Fault]:
    """Faults that the types do not exclude."""
    k = effector.components
    counts = {name: len(getattr(effector, name)) for name in ("weights", "means", "covariances")}
    wrong = [Fault(f"{where}.{name}", f"there are {n} for {k} components") for name, n in counts.items() if n != k]
    if effector.bandwidth_m <= 0.0:
        wrong.append(Fault(f"{where}.bandwidth_m", "it must be positive"))
    if k not in {trial.components for trial in effector.sizes}:
        wrong.append(Fault(f"{where}.sizes", f"there is no size {k}"))
    if k < 1:
        wrong.append(Fault(f"{where}.components", "there must be at least one"))
    if wrong:
        return wrong
    try:
        effector.to_mixture()
    except InvalidInput as error:
        return [Fault(f"{where}.{fault.where}", fault.message) for fault in error.faults]
    return []


def _damaged_file(path: Path, faults: list[Fault]) -> UnreadableFile:
    places = "; ".join(f"{fault.where}: {fault.message}" if fault.where else fault.message for fault in faults[:3])
    more = f" and {len(faults) - 3} more" if len(faults) > 3 else ""
    return UnreadableFile(
        "reachability-damaged",
        f"{path.parent.name}/{path.name} is not a valid file of learned densities: {places}{more}.",
        faults,
    )
