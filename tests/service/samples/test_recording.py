"""The shipped sample is what a fresh run gives, and seeding puts it into a service once."""

import asyncio
import hashlib
import importlib.util
import json
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from sqlalchemy import func, select, update
from sqlalchemy.ext.asyncio import AsyncEngine

from stridelab.schemas.jobs import (
    EstimateComInput,
    EstimateComSummary,
    SimulateRecordingInput,
    SimulateRecordingSummary,
)
from stridelab.schemas.recordings import RecordingFacts
from stridelab.service.jobs import retention
from stridelab.service.samples import recording as bundled
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.tables import job, recording
from support.service.database import run_with_engine

SAMPLE = bundled.sample_folder()
INDEX = json.loads((SAMPLE / bundled.INDEX_FILE).read_text())
SCRIPT = Path(__file__).parents[3] / "scripts" / "make_sample.py"


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = importlib.util.spec_from_file_location("make_sample", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    folder = tmp_path_factory.mktemp("sample")
    script.make_sample(folder)
    return folder


TOLERANCES = {"_m": 5e-4, "_m_s": 0.02, "_m_s2": 1.0, "_n": 1.0, "_nm": 1.0, "_nms": 0.01, "_s": 1e-9}
TOLERANCES |= dict.fromkeys(("unobservable_x", "unobservable_y", "unobservable_z"), 0.01)


@pytest.mark.parametrize("name", ["truth.parquet", "com.parquet", "tracks.parquet"])
def test_the_shipped_tables_are_those_of_a_fresh_run(fresh: Path, name: str) -> None:
    """Where this fails on purpose (a better estimator), run scripts/make_sample.py."""
    shipped, now = pq.read_table(SAMPLE / name), pq.read_table(fresh / name)
    assert shipped.column_names == now.column_names
    for column in shipped.column_names:
        before, after = shipped[column].to_numpy(), now[column].to_numpy()
        suffix = next((s for s in sorted(TOLERANCES, key=len, reverse=True) if column.endswith(s)), None)
        if suffix is None:
            np.testing.assert_array_equal(before, after, err_msg=column)
        else:
            np.testing.assert_allclose(after, before, rtol=0, atol=TOLERANCES[suffix], err_msg=column)


def test_the_index_is_that_of_a_fresh_run_and_of_this_contract(fresh: Path) -> None:
    now = json.loads((fresh / bundled.INDEX_FILE).read_text())
    assert {p.name for p in fresh.iterdir()} | {"README.md"} == {p.name for p in SAMPLE.iterdir()}
    for job_id, indexed_job in INDEX["jobs"].items():
        assert now["jobs"][job_id]["input"] == indexed_job["input"]
        assert now["jobs"][job_id]["result"]["summary"].keys() == indexed_job["result"]["summary"].keys()
        assert [a["name"] for a in now["jobs"][job_id]["result"]["artifacts"]] == [
            a["name"] for a in indexed_job["result"]["artifacts"]
        ]
        for artifact in indexed_job["result"]["artifacts"]:
            assert (SAMPLE / artifact["name"]).stat().st_size == artifact["bytes"]
    RecordingFacts.model_validate(INDEX["facts"])
    truth, estimate = (INDEX["jobs"][key] for key in (bundled.TRUTH_JOB, bundled.ESTIMATE_JOB))
    SimulateRecordingInput.model_validate(truth["input"])
    assert SimulateRecordingSummary.model_validate(truth["result"]["summary"]).recording_id == bundled.SAMPLE_ID
    EstimateComInput.model_validate(estimate["input"])
    EstimateComSummary.model_validate(estimate["result"]["summary"])
    assert INDEX["sha256"] == hashlib.sha256((SAMPLE / "recording.c3d").read_bytes()).hexdigest()


def test_no_file_of_the_sample_is_over_a_megabyte() -> None:
    assert all(path.stat().st_size < 1_000_000 for path in SAMPLE.iterdir())


def test_seeding_twice_at_once_and_again_leaves_one_sample(database_url: str, tmp_path: Path) -> None:
    blobs = BlobStore.from_url(tmp_path.as_uri())

    async def act(engine: AsyncEngine) -> Any:
        at_once = await asyncio.gather(*(bundled.seed_sample(engine, blobs) for _ in range(3)))
        again = await bundled.seed_sample(engine, blobs)
        async with engine.connect() as connection:
            rows = (await connection.execute(select(recording))).mappings().all()
            jobs = (await connection.execute(select(job))).mappings().all()
        return at_once, again, [dict(row) for row in rows], {row["id"]: dict(row) for row in jobs}

    at_once, again, rows, jobs = run_with_engine(database_url, act)
    assert sorted(at_once) == [False, False, True]
    assert again is False
    assert [row["id"] for row in rows] == [bundled.SAMPLE_ID]
    assert rows[0]["bundled"]
    assert rows[0]["truth_job_id"] == bundled.TRUTH_JOB
    assert {row["state"] for row in jobs.values()} == {"succeeded"}
    assert jobs[bundled.ESTIMATE_JOB]["recording_id"] == bundled.SAMPLE_ID
    for row in jobs.values():
        for artifact in row["result"]["artifacts"]:
            stored = tmp_path / row["blob_prefix"] / artifact["name"]
            assert stored.read_bytes() == (SAMPLE / artifact["name"]).read_bytes()
    assert (tmp_path / rows[0]["blob_key"]).read_bytes() == (SAMPLE / "recording.c3d").read_bytes()
    assert (tmp_path / rows[0]["tracks_key"]).is_file()


def test_an_older_or_damaged_sample_is_replaced(database_url: str, tmp_path: Path) -> None:
    blobs = BlobStore.from_url(tmp_path.as_uri())

    async def act(engine: AsyncEngine) -> Any:
        await bundled.seed_sample(engine, blobs)
        async with engine.begin() as connection:
            await connection.execute(update(recording).values(sha256="of an older version"))
        replaced = await bundled.seed_sample(engine, blobs)
        (tmp_path / f"recordings/{bundled.SAMPLE_ID}/recording.c3d").unlink()
        repaired = await bundled.seed_sample(engine, blobs)
        async with engine.connect() as connection:
            count = (await connection.execute(select(func.count()).select_from(recording))).scalar_one()
            return replaced, repaired, count

    assert run_with_engine(database_url, act) == (True, True, 1)
    assert (tmp_path / f"recordings/{bundled.SAMPLE_ID}/recording.c3d").is_file()


def test_retention_leaves_the_sample_alone(database_url: str, tmp_path: Path) -> None:
    blobs = BlobStore.from_url(tmp_path.as_uri())

    async def act(engine: AsyncEngine) -> Any:
        await bundled.seed_sample(engine, blobs)
        async with engine.connect() as connection:
            removed = await retention.remove_old_jobs(connection, blobs, timedelta(seconds=-1))
            orphans = await retention.remove_orphans(connection, blobs, timedelta(seconds=-1))
        return removed, orphans, await bundled.seed_sample(engine, blobs)

    assert run_with_engine(database_url, act) == ([], [], False)
