"""The bundled scenarios: files of ``models/scenarios``, stored as read-only rows.

The id of a bundled scenario is its file's stem. The id of a user's scenario is 32 random hexadecimal digits
(``new_id``), a form that bundled ones must not have, so that ids never clash.
"""

import json
import re
import uuid
from collections import Counter
from pathlib import Path
from typing import Any, Final

from sqlalchemy import delete, func, select
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.machine.models_folder import models_dir
from stridelab.schemas.scenarios import Scenario
from stridelab.service.storage import locks
from stridelab.service.storage.tables import scenario

EXAMPLE_ID: Final = "flat-walk"
"""The simplest bundled scenario."""

_STEM: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_USER_ID_FORM: Final = re.compile(r"[0-9a-f]{32}")


def new_id() -> str:
    """An id for a user's scenario."""
    return uuid.uuid4().hex


def scenarios_folder() -> Path:
    """Folder of the scenario files."""
    return models_dir() / "scenarios"


def bundled_scenarios(folder: Path | None = None) -> dict[str, dict[str, Any]]:
    """Bodies of all bundled scenarios by id; raises ``ValueError`` for an invalid file."""
    bodies = {}
    for file in sorted((folder or scenarios_folder()).glob("*.json")):
        if not _STEM.fullmatch(file.stem) or _USER_ID_FORM.fullmatch(file.stem) or len(file.stem) > 64:
            raise ValueError(f"{file.name} cannot be the name of a bundled scenario")
        body = Scenario.model_validate(json.loads(file.read_text(encoding="utf-8")))
        bodies[file.stem] = body.model_dump(mode="json")
    return bodies


def robots_by_frequency() -> list[str]:
    """Robots of the bundled scenarios, the most frequent first."""
    counts = Counter(body["robot"] for body in bundled_scenarios().values())
    return [name for name, _ in counts.most_common()]


async def seed_scenarios(engine: AsyncEngine, folder: Path | None = None) -> bool:
    """Synchronise the bundled rows with this version's files; True if anything had to be written.

    May be called by any number of processes at once and at every start. Rows without a file are removed, rows whose
    file has changed are replaced; users' scenarios are never touched.
    """
    bodies = bundled_scenarios(folder)
    async with engine.begin() as connection:
        await connection.execute(select(func.pg_advisory_xact_lock(locks.SCENARIO_SEEDING)))
        rows = await connection.execute(select(scenario.c.id, scenario.c.body).where(scenario.c.bundled))
        present = {row.id: row.body for row in rows}
        gone = sorted(present.keys() - bodies.keys())
        changed = {name: body for name, body in bodies.items() if present.get(name) != body}
        if gone:
            await connection.execute(delete(scenario).where(scenario.c.id.in_(gone)))
        for name, body in changed.items():
            values = {"body": body, "bundled": True, "owner": None, "updated_at": func.now()}
            put = insert(scenario).values(id=name, **values)
            await connection.execute(put.on_conflict_do_update(index_elements=["id"], set_=values))
    return bool(gone or changed)
