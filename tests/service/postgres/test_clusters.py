"""Clusters of other versions of PostgreSQL: older ones are upgraded at the start, the rest is refused."""

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import psycopg
import pytest

from stridelab.errors import Unavailable
from stridelab.service.postgres import clusters
from stridelab.service.postgres.embedded import EmbeddedPostgres
from stridelab.service.postgres.paths import MAJOR_VERSION, wheel_binaries, wheel_installations
from support.service.database import public_folder

ROWS: Final = 1000


@pytest.fixture
def folder() -> Iterator[Path]:
    with public_folder() as public:
        yield public


def older_binaries() -> Path:
    return next(path for path in wheel_installations() if path != wheel_binaries())


def cluster_of(folder: Path) -> Path:
    return Path(json.loads((folder / "postgres.json").read_text())["cluster"])


def sum_of_rows(url: str) -> int:
    with psycopg.connect(url) as connection:
        row = connection.execute("SELECT sum(n) FROM kept").fetchone()
        assert row is not None
        return int(row[0])


def make_old_cluster(folder: Path, *, killed: bool) -> Path:
    server = EmbeddedPostgres(folder, pg_bin=older_binaries())
    url = server.start()
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("CREATE TABLE kept (n int)")
        connection.execute("INSERT INTO kept SELECT generate_series(1, %s)", (ROWS,))
    if killed:
        os.kill(int(server.postmaster_pid or 0), signal.SIGKILL)
    server.stop()
    return cluster_of(folder)


@pytest.mark.parametrize("killed", [False, True], ids=["stopped", "killed"])
def test_a_cluster_of_an_older_version_is_upgraded_at_the_start(folder: Path, *, killed: bool) -> None:
    old = make_old_cluster(folder, killed=killed)
    assert clusters.cluster_version(old) < MAJOR_VERSION
    server = EmbeddedPostgres(folder)
    try:
        assert sum_of_rows(server.start()) == ROWS * (ROWS + 1) // 2
    finally:
        server.stop()
    assert clusters.cluster_version(cluster_of(folder)) == MAJOR_VERSION
    assert clusters.cluster_version(old) < MAJOR_VERSION, "the old cluster stays"
    before = cluster_of(folder)
    server.start()
    server.stop()
    assert cluster_of(folder) == before, "the second start upgrades nothing"


def test_an_upgrade_that_is_interrupted_begins_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The old cluster is the database until the new one is complete, whatever an interrupted upgrade left beside it."""
    old = make_old_cluster(folder, killed=False)
    with monkeypatch.context() as patch:
        complete = clusters.create_cluster

        def fail_half_way(*given: object, **options: object) -> None:
            complete(*given, **options)  # type: ignore[arg-type]
            raise Unavailable("postgres-cannot-run", "No space left on device.")

        patch.setattr(clusters, "create_cluster", fail_half_way)
        with pytest.raises(Unavailable, match=r"is unchanged\. No space left") as caught:
            EmbeddedPostgres(folder).start()
    assert caught.value.code == "cluster-version"
    assert cluster_of(folder) == old
    for name in (f"cluster-{MAJOR_VERSION}", f"cluster-{MAJOR_VERSION}.draft"):
        assert not (old.parent / name).exists()
        (old.parent / name).mkdir()
        (old.parent / name / "PG_VERSION").write_text(f"{MAJOR_VERSION}\n")
    server = EmbeddedPostgres(folder)
    try:
        assert sum_of_rows(server.start()) == ROWS * (ROWS + 1) // 2
    finally:
        server.stop()


@pytest.mark.parametrize(
    ("version", "advice"), [("14", "make a backup with it"), ("99", "STRIDELAB_PG_BIN to version 99")]
)
def test_a_cluster_of_a_version_that_is_not_installed_is_refused(folder: Path, version: str, advice: str) -> None:
    server = EmbeddedPostgres(folder)
    server.start()
    server.stop()
    (cluster_of(folder) / "PG_VERSION").write_text(f"{version}\n")
    with pytest.raises(Unavailable, match=advice) as caught:
        server.start()
    assert caught.value.code == "cluster-version"
    server.stop()
