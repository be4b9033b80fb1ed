"""Robots of users: their rows, and their files as a job's child needs them."""

import asyncio
import contextlib
import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from sqlalchemy import select
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import StridelabError
from stridelab.robots.card import robot_names
from stridelab.schemas.robots import NAME_PATTERN
from stridelab.service.filenames import BUNDLE_FILE, LEARNED_FILE, LINKS_FILE, STAGED_ROBOT
from stridelab.service.kinds.base import Blobs
from stridelab.service.source_hash import CACHED_LINKS_FILE, cached_files_prefix
from stridelab.service.storage.tables import robot

ROBOT_FOLDER: Final = "own-robots"
"""Key prefix of the files of robots: ``own-robots/<id>/<file>``."""
_LINKS_POLL_S: Final = 0.5
_UPLOAD: Final = "stridelab.service.kinds.robots.upload"
READ_ROBOT: Final = f"{_UPLOAD}:read_robot"
PROPOSE_CARD: Final = f"{_UPLOAD}:propose"
CHECK_CARD: Final = f"{_UPLOAD}:check_card"
LIST_PACKAGES: Final = f"{_UPLOAD}:list_packages"
PACK_INSTALLED: Final = f"{_UPLOAD}:pack_installed"
"""Import paths of the children of uploads: the service itself imports no rigid-body library."""


async def find_robot(connection: AsyncConnection, name: str, *, lock: bool = False) -> Mapping[str, Any] | None:
    """Row of the robot ``name`` of a user, optionally locked; None if there is none."""
    if not re.fullmatch(NAME_PATTERN, name):  # PostgreSQL refuses some texts, such as those with a null character
        return None
    query = select(robot).where(robot.c.name == name)
    row = (await connection.execute(query.with_for_update() if lock else query)).mappings().one_or_none()
    return None if row is None else dict(row)


def robot_version(row: Mapping[str, Any]) -> str:
    """Identifies what a child knows of a robot: its row, card and learned densities."""
    facts = [row["id"], row["card"], row["learned_key"]]
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


async def stage_robot(connection: AsyncConnection, blobs: Blobs, name: str | None, folder: Path) -> str | None:
    """Fetch the files of the robot ``name`` into ``folder``; returns its version, None for one that is not a user's."""
    row = None if name is None else await find_robot(connection, name)
    if row is None:
        return None
    await blobs.get_file(row["bundle_key"], folder / BUNDLE_FILE)
    if row["learned_key"] is not None:
        await blobs.get_file(row["learned_key"], folder / LEARNED_FILE)
    write_staged_robot(folder, row["name"], row["card"])
    return robot_version(row)


async def stage_links(connection: AsyncConnection, blobs: Blobs, name: str, folder: Path) -> None:
    """Fetch the display meshes of the robot ``name`` into ``folder``, if they are stored.

    A run without them makes them anew.
    """
    row = await find_robot(connection, name)
    with contextlib.suppress(StridelabError):  # the run says what is wrong with the robot
        if row is None:
            key = f"{await asyncio.to_thread(cached_files_prefix, name)}/{CACHED_LINKS_FILE}"
        else:
            key = row["links_key"]
        if await blobs.exists(key):
            await blobs.get_file(key, folder / LINKS_FILE)


async def await_links(blobs: Blobs, name: str, folder: Path) -> None:
    """Fetch the display meshes of a bundled robot into ``folder`` once they are stored, unless they are there.

    A service makes them after its first start, when a plan may run already.
    """
    links, part = folder / LINKS_FILE, folder / f".{LINKS_FILE}"
    if links.exists() or name not in robot_names():
        return
    with contextlib.suppress(StridelabError, OSError):  # the run says what is wrong with the robot
        key = f"{await asyncio.to_thread(cached_files_prefix, name)}/{CACHED_LINKS_FILE}"
        while not await blobs.exists(key):
            await asyncio.sleep(_LINKS_POLL_S)
        await blobs.get_file(key, part)
        part.replace(links)


async def stored_bytes(blobs: Blobs, row: Mapping[str, Any]) -> int:
    """Bytes of the present files of a robot; those of earlier densities are removed and do not count."""
    keys = [row[name] for name in ("bundle_key", "links_key", "learned_key") if row[name] is not None]
    found = [await blobs.info(key) for key in keys]
    return sum(one.bytes for one in found if one is not None)


def write_staged_robot(folder: Path, name: str, card: Mapping[str, Any]) -> None:
    """Write the file from which the child takes name and card."""
    (folder / STAGED_ROBOT).write_text(json.dumps({"name": name, "card": card}), encoding="utf-8")
