"""The scenarios that come with the program get into a service once, follow their files, and leave users' ones alone."""

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import insert, select, update
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.service.api.app import create_app
from stridelab.service.samples import scenarios
from stridelab.service.samples.scenario_bodies import ONE_STEP
from stridelab.service.settings import Settings
from stridelab.service.storage.tables import scenario
from support.service.database import run_with_engine


async def rows(engine: AsyncEngine) -> dict[str, dict[str, Any]]:
    async with engine.connect() as connection:
        stored_rows = (await connection.execute(select(scenario))).mappings().all()
    return {row["id"]: dict(row) for row in stored_rows}


def write(folder: Path, stem: str, **changes: Any) -> None:
    (folder / f"{stem}.json").write_text(json.dumps({**ONE_STEP, **changes}), encoding="utf-8")


def test_seeding_at_once_and_again_leaves_every_file_once(database_url: str) -> None:
    async def act(engine: AsyncEngine) -> Any:
        at_once = await asyncio.gather(*(scenarios.seed_scenarios(engine) for _ in range(4)))
        first = await rows(engine)
        return at_once, first, await scenarios.seed_scenarios(engine), await rows(engine)

    at_once, first, again, second = run_with_engine(database_url, act)
    assert sorted(at_once) == [False, False, False, True]
    assert again is False
    assert first == second
    files = {file.stem for file in scenarios.scenarios_folder().glob("*.json")}
    assert first.keys() == files
    assert scenarios.EXAMPLE_ID in files
    assert all(row["bundled"] and row["owner"] is None for row in first.values())


def test_a_service_has_them_from_the_start(database_url: str, tmp_path: Path) -> None:
    app = create_app(Settings(database_url=database_url, data_dir=tmp_path), with_sample=True)

    async def act(engine: AsyncEngine) -> Any:
        async with app.router.lifespan_context(app):
            return await rows(engine)

    assert run_with_engine(database_url, act).keys() == scenarios.bundled_scenarios().keys()


def test_rows_follow_their_files(database_url: str, tmp_path: Path) -> None:
    write(tmp_path, "stays")
    write(tmp_path, "changes", name="before")
    write(tmp_path, "goes")

    async def act(engine: AsyncEngine) -> Any:
        assert await scenarios.seed_scenarios(engine, tmp_path)
        before = await rows(engine)
        write(tmp_path, "changes", name="after")
        write(tmp_path, "comes")
        (tmp_path / "goes.json").unlink()
        assert await scenarios.seed_scenarios(engine, tmp_path)
        return before, await rows(engine)

    before, after = run_with_engine(database_url, act)
    assert after.keys() == {"stays", "changes", "comes"}
    assert after["stays"] == before["stays"]
    assert after["changes"]["body"]["name"] == "after"
    assert after["changes"]["created_at"] == before["changes"]["created_at"]
    assert after["changes"]["updated_at"] > before["changes"]["updated_at"]


def test_a_damaged_row_is_repaired_and_users_scenarios_stay(database_url: str, tmp_path: Path) -> None:
    write(tmp_path, "walk")
    users = scenarios.new_id()

    async def act(engine: AsyncEngine) -> Any:
        await scenarios.seed_scenarios(engine, tmp_path)
        async with engine.begin() as connection:
            await connection.execute(update(scenario).values(body={"name": "nonsense"}))
            await connection.execute(insert(scenario).values(id=users, body=ONE_STEP))
        assert await scenarios.seed_scenarios(engine, tmp_path)
        (tmp_path / "walk.json").unlink()
        repaired_rows = await rows(engine)
        assert await scenarios.seed_scenarios(engine, tmp_path)
        return repaired_rows, await rows(engine)

    repaired_rows, deleted_rows = run_with_engine(database_url, act)
    assert repaired_rows["walk"]["body"]["name"] == ONE_STEP["name"]
    assert deleted_rows == {users: repaired_rows[users]}
    assert deleted_rows[users]["bundled"] is False


@pytest.mark.parametrize("stem", ["0" * 32, "Walk", "a b", "a_b", "a.b", "-a", "x" * 65, "schön"])
def test_no_file_can_take_the_id_of_a_users_scenario(tmp_path: Path, stem: str) -> None:
    write(tmp_path, stem)
    with pytest.raises(ValueError, match="cannot be the name"):
        scenarios.bundled_scenarios(tmp_path)


def test_a_users_id_is_never_that_of_a_file() -> None:
    ids = {scenarios.new_id() for _ in range(100)}
    assert len(ids) == 100
    assert all(len(each) == 32 and set(each) <= set("0123456789abcdef") for each in ids)


def test_a_damaged_file_is_not_seeded(database_url: str, tmp_path: Path) -> None:
    (tmp_path / "walk.json").write_text('{"name": "x"}', encoding="utf-8")
    with pytest.raises(ValueError, match="robot"):
        run_with_engine(database_url, lambda engine: scenarios.seed_scenarios(engine, tmp_path))
    assert run_with_engine(database_url, rows) == {}


def test_the_robot_of_most_scenarios_comes_first() -> None:
    named = [body["robot"] for body in scenarios.bundled_scenarios().values()]
    assert scenarios.robots_by_frequency()[0] == max(set(named), key=named.count)
    assert set(scenarios.robots_by_frequency()) == set(named)
