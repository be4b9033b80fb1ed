"""The job kind ``commission-robot``."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sqlalchemy import update
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Fault, NotFound
from stridelab.schemas.robots import CommissionRobotInput, CommissionRobotSummary
from stridelab.service.filenames import LEARNED_FILE, ROBOT_STATE_FILE, STAGED_ROBOT
from stridelab.service.kinds.base import Blobs, JobKind, Json
from stridelab.service.kinds.staging import stage_input
from stridelab.service.storage.content_addressed import lock_blob
from stridelab.service.storage.tables import robot
from stridelab.service.stored_robots import ROBOT_FOLDER, find_robot, stored_bytes


async def stage(connection: AsyncConnection, blobs: Blobs, request: CommissionRobotInput, folder: Path) -> Json:
    """Fetch the robot. Raises ``NotFound`` (``robot-not-found``) for one that is bundled or was deleted."""
    if await find_robot(connection, request.robot) is None:
        message = f"There is no robot {request.robot} of a user; it may have been deleted since the job was accepted."
        raise NotFound("robot-not-found", message, [Fault("robot", "unknown")])
    return await stage_input(connection, blobs, request, folder)


async def publish(
    connection: AsyncConnection, blobs: Blobs, job_row: Mapping[str, Any], outcome: Json, folder: Path
) -> Json | None:
    """Store the densities with the robot, unless its card was changed or it was deleted in the meantime."""
    summary = CommissionRobotSummary.model_validate(outcome["summary"])
    staged = json.loads((folder / STAGED_ROBOT).read_text(encoding="utf-8"))
    row = await find_robot(connection, summary.robot, lock=True)
    if row is None or row["card"] != staged["card"]:
        return None
    key = f"{ROBOT_FOLDER}/{row['id']}/learned-{job_row['id']}.zip"
    await lock_blob(connection, key)
    await blobs.put_file(key, folder / LEARNED_FILE)
    state = json.loads((folder / ROBOT_STATE_FILE).read_text(encoding="utf-8"))
    walk = summary.first_walk
    values = {
        "state": "commissioned" if walk.certified and walk.completed else "not-walking",
        "learned_key": key,
        "bytes": await stored_bytes(blobs, {**row, "learned_key": key}),
        "facts": state["facts"],
        "shapes": state["shapes"],
        "commission": outcome["summary"],
    }
    await connection.execute(update(robot).where(robot.c.id == row["id"]).values(values))
    return None


KIND = JobKind(
    name="commission-robot",
    title="Commissioned robot",
    description="Learns where the centre of mass of one's own robot can be, then plans a level walk for it, certifies "
    "it and replays it in a physics simulation, and searches its largest turn, highest stair, fastest pace and pushes.",
    examples={"own": {"summary": "A robot that was uploaded", "value": {"robot": "my-robot", "samples": 3000}}},
    input_model=CommissionRobotInput,
    summary_model=CommissionRobotSummary,
    stage=stage,
    publish=publish,
    timeout_s=1800.0,
    memory_mb=4096,
    lane="long",
)
