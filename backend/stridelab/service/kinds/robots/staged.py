"""Makes the robot of a user known to a child: unpacks its description and densities into the child's folder."""

import json
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from stridelab.errors import Fault, InvalidInput, UnreadableFile
from stridelab.machine.cluster import leave_cluster
from stridelab.machine.models_folder import add_models_folder
from stridelab.robots.card import RobotCard, card_of_fields, invalid_card
from stridelab.robots.proposal.propose import URDF, card_toml
from stridelab.schemas.robots import NAME_PATTERN
from stridelab.service.filenames import BUNDLE_FILE, LEARNED_FILE, STAGED_ROBOT

MODELS_FOLDER: Final = "models"
_BUNDLED: Final = re.compile(r"robot\.urdf|mesh-\d{4}\.stl")
_LEARNED: Final = re.compile(r"(uniform|conditioned)\.(json|npz)")
MAX_PATTERN: Final = 10_000


def use_staged_robot(folder: Path) -> str:
    """Unpack the robot that was staged in ``folder`` and make it known to this machine only; returns its name.

    Raises ``InvalidInput`` (``robot-card-invalid``), ``UnreadableFile`` (``stored-file-damaged``).
    """
    leave_cluster()  # other machines do not have the files
    staged = json.loads((folder / STAGED_ROBOT).read_text(encoding="utf-8"))
    name = str(staged["name"])
    if not re.fullmatch(NAME_PATTERN, name):
        raise InvalidInput("invalid-request", "The name of the robot is invalid.", [Fault("name", "invalid")])
    models = folder / MODELS_FOLDER
    _unpack(folder / BUNDLE_FILE, models / "robots" / name, _BUNDLED)
    if (folder / LEARNED_FILE).is_file():
        _unpack(folder / LEARNED_FILE, models / "reachability" / name, _LEARNED)
    write_card(models, name, own_card(name, staged["card"]))
    return name


def own_card(name: str, fields: Mapping[str, Any]) -> RobotCard:
    """The card of a user's robot; the service alone defines where its files are. Raises as ``parse_card``."""
    if "data" in fields:
        raise invalid_card(name, [Fault("data", "the service defines it; leave it out")])
    if len(json.dumps(fields)) > 40 * MAX_PATTERN:
        raise invalid_card(name, [Fault("", "it is too large")])
    return card_of_fields(name, {**fields, "data": {"urdf": f"{name}/{URDF}"}})


def write_card(models: Path, name: str, card: RobotCard) -> None:
    """Write the card of a robot into a models folder, and make the folder known to this process."""
    (models / "robots" / f"{name}.toml").write_text(card_toml(card), encoding="utf-8")
    add_models_folder(models)


def _unpack(archive: Path, folder: Path, allowed: re.Pattern[str]) -> None:
    """Unpack the allowed members; the zip's checksums are those of the stored files.

    Raises ``UnreadableFile`` (``stored-file-damaged``).
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with zipfile.ZipFile(archive) as packed:
            for member in packed.infolist():
                if allowed.fullmatch(member.filename):
                    (folder / member.filename).write_bytes(packed.read(member))
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError) as error:
        raise UnreadableFile(
            "stored-file-damaged",
            "A stored file of this robot is damaged; upload the robot again, or restore it from a backup.",
            [Fault(archive.name, "damaged")],
        ) from error


def pack_files(files: Mapping[str, Path], target: Path) -> None:
    """Write a zip of ``files`` by name; the same files give the same bytes."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, path in sorted(files.items()):
            packed.writestr(zipfile.ZipInfo(name), path.read_bytes(), zipfile.ZIP_DEFLATED)
