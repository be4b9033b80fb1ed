"""Scenarios to send and to store, made from the one of the interface's description."""

import json
from typing import Any

from sqlalchemy import insert

from stridelab.schemas.scenarios import Scenario
from stridelab.service.api.dependencies import Parts
from stridelab.service.samples.scenario_bodies import ONE_STEP
from stridelab.service.samples.scenarios import new_id
from stridelab.service.storage.tables import scenario


def one_step(**changes: Any) -> dict[str, Any]:
    """A valid body, with fields replaced."""
    return {**json.loads(json.dumps(ONE_STEP)), **changes}


def with_contact(phase: int, contact: int, **changes: Any) -> dict[str, Any]:
    """``one_step`` with fields of one contact replaced."""
    body = one_step()
    body["phases"][phase]["contacts"][contact] |= changes
    return body


async def add_scenario(parts: Parts, scenario_id: str | None = None, **columns: Any) -> str:
    """Insert a scenario unchecked; returns its id."""
    scenario_id = scenario_id or new_id()
    body = Scenario.model_validate(one_step()).model_dump(mode="json")
    async with parts.engine.begin() as connection:
        await connection.execute(insert(scenario).values({"id": scenario_id, "body": body, **columns}))
    return scenario_id
