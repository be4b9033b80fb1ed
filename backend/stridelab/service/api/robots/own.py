"""Robots of users: upload, change of the card, deletion."""

import hashlib
import io
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import anyio
from sqlalchemy import delete, insert, select, update
from sqlalchemy.ext.asyncio import AsyncConnection

from stridelab.errors import Conflict, Fault, InvalidInput, NotFound, StridelabError, TooLarge, UnreadableFile
from stridelab.robots.card import robot_names
from stridelab.robots.data_files import shared_folders
from stridelab.robots.proposal.offered_estimates import chosen_estimate, estimate_of
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.schemas.robots import EarlierCard, Measure, OwnRobot, RobotFacts, RobotPackage, RobotSummary
from stridelab.service.api.dependencies import Parts
from stridelab.service.api.quotas import refuse_full
from stridelab.service.api.recordings.multipart import ReceivedFile
from stridelab.service.api.recordings.parse import ROBOT_FAILURES, run_reader
from stridelab.service.auth import audit
from stridelab.service.auth.callers import Caller, require_owner
from stridelab.service.filenames import BUNDLE_FILE, INSTALLED_FILE, LINKS_FILE, child_output_file, safe_filename
from stridelab.service.processes.sandbox import STRICT, Sandbox
from stridelab.service.storage.content_addressed import lock_blob
from stridelab.service.storage.file_removal import may_remove
from stridelab.service.storage.publication import publish_files
from stridelab.service.storage.tables import job, robot, scenario
from stridelab.service.stored_robots import (
    CHECK_CARD,
    LIST_PACKAGES,
    PACK_INSTALLED,
    PROPOSE_CARD,
    READ_ROBOT,
    ROBOT_FOLDER,
    find_robot,
    stored_bytes,
    write_staged_robot,
)

PROPOSAL_TIMEOUT_S: Final = 90.0
"""Time limit of the proposal, which reads rebuilt files only."""
EARLIER_CARDS: Final = 20
"""Earlier cards of a robot that are stored; some 10 kB each."""
PACKAGES_TIMEOUT_S: Final = 30.0
"""Time limit of listing or packing installed robots, which may lie on a slow shared disk."""
RESERVED_NAMES: Final = ("human", "packages")
"""Names that mean something else: the simulated person, and the list of packages."""


async def list_installed(parts: Parts) -> list[RobotPackage]:
    """Robots in installed packages, listed once by a confined child.

    Raises ``UnreadableFile`` if the child fails or takes too long.
    """

    async def list_packages() -> list[RobotPackage]:
        with tempfile.TemporaryDirectory(dir=parts.spool) as folder:
            value = await _run_child(parts, LIST_PACKAGES, {}, Path(folder), PACKAGES_TIMEOUT_S, _package_sandbox())
        return [RobotPackage.model_validate(one) for one in value["summary"]["packages"]]

    return await parts.robots.packages.get("", list_packages)


async def add_installed_robot(
    parts: Parts, caller: Caller, fields: Mapping[str, str], name: str, folder: Path
) -> OwnRobot:
    """Pack the description of an installed package in a confined child, and add it as an upload.

    Raises ``InvalidInput`` (``robot-package-unknown``, ``robot-description-missing``, ``robot-several-descriptions``,
    ``robot-package-too-large``), ``TooLarge`` (``upload-too-large``), and as ``add_robot``.
    """
    await _refuse_taken(parts, name)
    task = {key: fields[key] for key in ("package", "description") if key in fields}
    value = await _run_child(parts, PACK_INSTALLED, task, folder, PACKAGES_TIMEOUT_S, _package_sandbox())
    packed = child_output_file(folder, INSTALLED_FILE)
    size = packed.stat().st_size
    if size > parts.settings.max_upload_mb * 1_000_000:
        message = f"The robot has more than {parts.settings.max_upload_mb:g} MB, the limit of this service."
        raise TooLarge("upload-too-large", message, [Fault("package", "too large")])
    digest = await anyio.to_thread.run_sync(_sha256, packed)
    file = ReceivedFile(packed, safe_filename(value["summary"]["filename"]), size, digest)
    return await add_robot(parts, caller, file, name, value["summary"]["inside"])


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _package_sandbox() -> Sandbox:
    """What a child that reads installed packages may read besides Python's own folders."""
    return Sandbox(folders=shared_folders())


async def add_robot(parts: Parts, caller: Caller, form: ReceivedFile, name: str, description: str = "") -> OwnRobot:
    """Read an uploaded robot in confined children and store it with its proposed card.

    ``description`` is the path, or its end, of the one that is read from a zip with several.

    Raises ``Conflict`` (``robot-name-taken``), ``TooLarge`` (``storage-limit``), ``UnreadableFile`` and
    ``InvalidInput`` with the reason for which the robot is refused.
    """
    folder = form.path.parent
    await _refuse_taken(parts, name)
    await refuse_full(parts, caller.name, form.size_bytes)
    read = {"file": form.path.name, "filename": form.filename, "name": name, "description": description}
    value = await _run_child(parts, READ_ROBOT, read, folder, parts.settings.parse_timeout_s)
    title = form.filename.rpartition(".")[0][:60] or name
    task = {"name": name, "title": title, "assumed": value["summary"]["assumed"]}
    value = await _run_child(parts, PROPOSE_CARD, task, folder, PROPOSAL_TIMEOUT_S)
    summary = value["summary"]
    bundle, links = (child_output_file(folder, file) for file in (BUNDLE_FILE, LINKS_FILE))
    robot_id = uuid.uuid4().hex
    prefix = f"{ROBOT_FOLDER}/{robot_id}"
    keys = {"bundle_key": f"{prefix}/{BUNDLE_FILE}", "links_key": f"{prefix}/{LINKS_FILE}"}
    row = {
        "id": robot_id,
        "owner": caller.name,
        "name": name,
        "filename": form.filename,
        "sha256": form.sha256,
        "bytes": bundle.stat().st_size + links.stat().st_size,
        "state": "proposed",
        **keys,
        **{column: summary[column] for column in ("card", "assumed", "facts", "shapes")},
    }
    RobotFacts.model_validate(row["facts"])  # the child has read a stranger's bytes
    async with publish_files(lambda: _discard_files(parts, prefix)) as publication:
        async with publication.transaction(parts.engine) as connection:
            for key, path in zip(keys.values(), (bundle, links), strict=True):
                await lock_blob(connection, key)
                await parts.blobs.put_file(key, path)
            await lock_blob(connection, f"robot {name}")
            if await find_robot(connection, name) is not None:
                raise _name_taken(name)
            await connection.execute(insert(robot).values(row))
            await audit.record_action(connection, caller, "robot-added", name)
            stored = own_robot(await required_robot(connection, name))
        publication.record_outcome(published=True)
    return stored


async def replace_card(parts: Parts, caller: Caller, name: str, fields: dict[str, Any], folder: Path) -> OwnRobot:
    """Check a card in a child and store it; densities that were learned with another card are dropped.

    Raises ``NotFound`` (``robot-not-found``), ``Forbidden`` (``not-owner``), ``Conflict`` (``changed-meanwhile``),
    ``InvalidInput`` (``robot-card-invalid``, ``robot-description-invalid``).
    """
    async with parts.engine.connect() as connection:
        row = await required_robot(connection, name)
    require_owner(caller, row["owner"], "robot")
    await parts.blobs.get_file(row["bundle_key"], folder / BUNDLE_FILE)
    write_staged_robot(folder, name, fields)
    value = await _run_child(parts, CHECK_CARD, {"name": name}, folder, PROPOSAL_TIMEOUT_S)
    summary = value["summary"]
    RobotFacts.model_validate(summary["facts"])
    changed = summary["card"] != row["card"]
    values = {column: summary[column] for column in ("card", "facts", "shapes")}
    if changed:
        values |= {"state": "proposed", "learned_key": None, "commission": None}
        values["bytes"] = await stored_bytes(parts.blobs, {**row, "learned_key": None})
        values |= _next_version(row, summary["card"])
    async with parts.engine.begin() as connection:
        present = await find_robot(connection, name, lock=True)
        if present is None or present["card"] != row["card"]:
            raise Conflict("changed-meanwhile", "The robot was changed by another request in the meantime; try again.")
        if not changed:  # what was learned stays; a robot of an earlier version gets the dimensions that it lacked
            values = {"facts": {**present["facts"], "walker": summary["facts"]["walker"]}}
        await connection.execute(update(robot).where(robot.c.id == row["id"]).values(values))
        if changed:
            await audit.record_action(connection, caller, "robot-card-changed", name)
        return own_robot(await required_robot(connection, name))


def _next_version(row: Mapping[str, Any], card: Mapping[str, Any]) -> dict[str, Any]:
    """Columns of the row with a new card; a card that is taken back is assumed as it was."""
    replaced = EarlierCard(
        version=row["version"], card=row["card"], assumptions=row["assumed"], replaced_at=datetime.now(UTC)
    )
    earlier = [*row["earlier"], replaced.model_dump(mode="json")][-EARLIER_CARDS:]
    taken_back = next((one["assumptions"] for one in reversed(earlier) if one["card"] == card), None)
    assumed = _still_assumed(row["assumed"], row["card"], card) if taken_back is None else taken_back
    return {"version": row["version"] + 1, "earlier": earlier, "assumed": assumed}


async def delete_robot(parts: Parts, caller: Caller, name: str) -> None:
    """Delete a user's robot with its files.

    Raises ``NotFound`` (``robot-not-found``), ``Forbidden`` (``not-owner``), ``Conflict`` (``robot-in-use``) naming
    the scenarios and unfinished jobs that need it.
    """
    async with parts.engine.begin() as connection:
        row = await required_robot(connection, name, lock=True)
        require_owner(caller, row["owner"], "robot")
        users = await _users_of(connection, name)
        if users:
            message = f"The robot {name} is in use; delete first what needs it: {', '.join(f.where for f in users)}."
            raise Conflict("robot-in-use", message, users)
        await connection.execute(delete(robot).where(robot.c.id == row["id"]))
        await audit.record_action(connection, caller, "robot-deleted", name)
    await _discard_files(parts, f"{ROBOT_FOLDER}/{row['id']}")


async def _users_of(connection: AsyncConnection, name: str) -> list[Fault]:
    """Scenarios and unfinished jobs that name the robot."""
    scenarios = select(scenario.c.id).where(scenario.c.body["robot"].astext == name).limit(20)
    named = job.c.input.contains({"robot": name}) | job.c.input.contains({"scenario": {"robot": name}})
    jobs = select(job.c.id).where(job.c.state.not_in(FINAL_STATES), named).limit(20)
    faults = [Fault(f"scenario {one}", "is for this robot") for one in (await connection.execute(scenarios)).scalars()]
    return faults + [Fault(f"job {one}", "uses it") for one in (await connection.execute(jobs)).scalars()]


async def own_summaries(parts: Parts) -> list[RobotSummary]:
    """Robots of users, by name."""
    columns = (robot.c.name, robot.c.card, robot.c.state, robot.c.owner)
    async with parts.engine.connect() as connection:
        rows = (await connection.execute(select(*columns).order_by(robot.c.name))).mappings().all()
    return [
        RobotSummary(
            name=row["name"],
            title=row["card"]["title"],
            licence=row["card"]["licence"],
            available=True,
            effectors=list(row["card"]["effectors"]),
            state=row["state"],
            owner=row["owner"],
        )
        for row in rows
    ]


def own_robot(row: Mapping[str, Any]) -> OwnRobot:
    """The robot of a row, for responses."""
    same = ("name", "state", "owner", "card", "version", "earlier", "filename", "sha256", "created_at")
    fields = {name: row[name] for name in same}
    return OwnRobot(
        **fields,
        assumed=list(row["assumed"]),
        assumptions=row["assumed"],
        estimates={field: estimate for field, how in row["assumed"].items() if (estimate := estimate_of(how))},
        robot_sha256=row["facts"]["sha256"],
        commission=row["commission"],
    )


async def required_robot(connection: AsyncConnection, name: str, *, lock: bool = False) -> Mapping[str, Any]:
    """Row of a user's robot. Raises ``NotFound`` (``robot-not-found``), ``Conflict`` (``bundled-read-only``)."""
    if name in robot_names():
        raise Conflict(
            "bundled-read-only", f"The robot {name} is part of the program and cannot be changed or deleted."
        )
    row = await find_robot(connection, name, lock=lock)
    if row is None:
        raise NotFound("robot-not-found", "There is no robot of this name.")
    return row


def _still_assumed(assumed: Mapping[str, str], before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, str]:
    """Assumptions about fields of the card that are the same in both cards, and those about the description.

    A field whose estimate was chosen is assumed from then on.
    """

    def value_of(card: Mapping[str, Any], field: str) -> Any:
        value: Any = card
        while field and isinstance(value, dict):
            key = next((key for key in value if field == key or field.startswith(f"{key}.")), None)
            if key is None:
                return None
            value, field = value[key], field[len(key) + 1 :]
        return value

    kept = {field: how for field, how in assumed.items() if value_of(before, field) == value_of(after, field)}
    chosen = {
        field: chosen_estimate(how)
        for field, how in assumed.items()
        if field not in kept and (estimate := estimate_of(how)) and value_of(after, field) == estimate
    }
    return kept | chosen


async def _refuse_taken(parts: Parts, name: str) -> None:
    if name in (*robot_names(), *RESERVED_NAMES):
        raise _name_taken(name)
    async with parts.engine.connect() as connection:
        if await find_robot(connection, name) is not None:
            raise _name_taken(name)


def _name_taken(name: str) -> Conflict:
    message = f"There is a robot named {name}; choose another name, or delete that robot first."
    return Conflict("robot-name-taken", message, [Fault("name", "taken")])


async def _run_child(
    parts: Parts, target: str, task: Mapping[str, Any], folder: Path, timeout_s: float, sandbox: Sandbox = STRICT
) -> dict[str, Any]:
    limiter = parts.robot_readers
    try:
        outcome = await run_reader(parts, target, task, folder, ROBOT_FAILURES, "file", timeout_s, limiter, sandbox)
        return dict(outcome.value)
    except (InvalidInput, UnreadableFile, Conflict):
        raise
    except StridelabError as error:
        raise UnreadableFile(
            "robot-data-unreadable", error.message, error.faults or [Fault("file", "unreadable")]
        ) from error


async def _discard_files(parts: Parts, prefix: str) -> None:
    async with parts.engine.begin() as connection:
        if await may_remove(connection):
            await parts.blobs.delete_prefix(prefix)


async def own_reachability(parts: Parts, row: Mapping[str, Any], measure: Measure | None) -> bytes:
    """``RobotReachability`` of a user's robot as gzipped JSON. Raises ``NotFound`` (``reachability-not-learned``)."""
    used = measure or row["facts"]["default_measure"]
    if row["learned_key"] is not None:
        content = b"".join([chunk async for chunk in parts.blobs.stream(row["learned_key"])])
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            return packed.read(f"{used}-reachability.json.gz")
    raise NotFound("reachability-not-learned", f"The robot {row['name']} has not been commissioned yet.")
