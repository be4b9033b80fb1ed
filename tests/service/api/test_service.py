"""The service about itself: health, metrics, logs."""

import asyncio
import io
import json
import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx
import psycopg
import pytest
import structlog
from prometheus_client.parser import text_string_to_metric_families

from stridelab import __version__
from stridelab.errors import Unavailable
from stridelab.service.api.app import create_app
from stridelab.service.logging import BURST, RATE_HZ, RepeatedLineFilter, configure_logging
from stridelab.service.settings import Settings
from support.service.database import TestDatabases
from support.service.stored_rows import add_job, add_recording, fail_attempt, start_job
from support.service.web_server import Served, served


def test_a_healthy_service_reports_version_and_uptime(http: httpx.Client) -> None:
    body = http.get("/api/v1/health").json()
    assert (body["status"], body["database"], body["version"]) == ("ok", "ok", __version__)
    assert body["uptime_s"] >= 0


def test_without_its_database_the_service_reports_it_and_stays_up(postgres: TestDatabases, tmp_path: Path) -> None:
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        engine = service.parts.engine
        missing_database = engine.url.set(database="nowhere")
        service.app.state.parts = _with_engine(service, str(missing_database.render_as_string(hide_password=False)))
        for path in ("/api/v1/health", "/api/v1/recordings", "/metrics"):
            answer = http.get(path)
            assert (answer.status_code, answer.json()["code"]) == (503, "database-unreachable")
        lost = service.app.state.parts.engine
        service.app.state.parts = _with_engine(service, engine.url.render_as_string(hide_password=False))
        assert http.get("/api/v1/health").status_code == 200
        service.run(lost.dispose())
        service.run(service.parts.engine.dispose())
        service.run(engine.dispose())


def _with_engine(service: Served, url: str) -> object:
    from dataclasses import replace

    from stridelab.service.storage.database import make_engine

    async def made() -> object:
        return replace(service.parts, engine=make_engine(url))

    return service.run(made())


def test_an_application_without_database_address_does_not_start() -> None:
    app = create_app(Settings(database_url=None))

    async def start() -> None:
        async with app.router.lifespan_context(app):
            pytest.fail("it started")

    with pytest.raises(Unavailable, match="STRIDELAB_DATABASE_URL"):
        asyncio.run(start())


def test_metrics_count_what_is_there(postgres: TestDatabases, tmp_path: Path) -> None:
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        recording_id = service.run(add_recording(service.parts))
        jobs = [service.run(add_job(service.parts, recording_id)) for _ in range(4)]
        for job_id in jobs[:2]:
            service.run(fail_attempt(service.parts, service.run(start_job(service.parts, job_id))))
        with psycopg.connect(url) as connection:
            connection.execute(
                "UPDATE job SET started_at = created_at + interval '2 s', finished_at = created_at + interval '7 s',"
                ' attempt = 3, error = \'{"code": "computation-crashed"}\' WHERE id = %s',
                (jobs[0],),
            )
            connection.execute("INSERT INTO worker (last_heartbeat) VALUES (now()), (now() - interval '1 h')")
        answer = http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    samples = {
        (sample.name.removeprefix("stridelab_"), *sorted(sample.labels.values())): sample.value
        for family in text_string_to_metric_families(answer.text)
        for sample in family.samples
    }
    assert samples["jobs", "estimate-com", "queued"] == 2
    assert samples["jobs", "estimate-com", "failed"] == 2
    took = {limit: samples["job_duration_seconds_bucket", limit, "estimate-com", "failed"] for limit in ("3.0", "10.0")}
    assert took == {"3.0": 1, "10.0": 2}
    assert samples["job_duration_seconds_bucket", "+Inf", "estimate-com", "failed"] == 2
    assert samples["job_duration_seconds_count", "estimate-com", "failed"] == 2
    assert 5.0 <= samples["job_duration_seconds_sum", "estimate-com", "failed"] < 8.0
    assert samples["job_wait_seconds_bucket", "3.0", "estimate-com"] == 2
    assert samples["job_failures", "computation-crashed", "estimate-com"] == 1
    assert samples["child_crashes", "crash", "estimate-com"] == 1
    assert samples["job_lost_starts",] == 2
    assert (samples["workers", "alive"], samples["workers", "silent"]) == (1, 1)
    assert (samples["queue_depth", "long"], samples["queue_depth", "short"]) == (0, 2)
    assert samples["queue_oldest_seconds",] > 0
    assert samples["recordings",] == 1
    assert samples["upload_bytes",] == len(recording_id)
    assert samples["database_bytes",] > 1e6


@pytest.fixture
def lines() -> Iterator[io.StringIO]:
    """What is logged, with everything put back at the end."""
    root, out = logging.getLogger(), io.StringIO()
    handlers, level, before = root.handlers[:], root.level, structlog.get_config()
    configure_logging("info", out)
    yield out
    root.handlers[:] = handlers
    root.setLevel(level)
    structlog.configure(**before)
    for name in ("uvicorn.access", "httpx", "httpcore", "alembic", "websockets"):
        logging.getLogger(name).setLevel(logging.NOTSET)


def test_a_request_is_one_line_without_personal_data(
    lines: io.StringIO, postgres: TestDatabases, tmp_path: Path
) -> None:
    with postgres.fresh() as url, served(url, tmp_path) as service, service.http() as http:
        configure_logging("info", lines)
        job_id = service.run(add_job(service.parts))
        answers = [
            http.get(f"/api/v1/jobs/{job_id}"),
            http.get("/api/v1/Erika-Mustermann?name=Erika"),
            http.post("/api/v1/subjects", json={"name": "Erika"}),
            http.post("/api/v1/recordings", files={"file": ("Erika.c3d", b"")}, data={"subject_name": "Erika"}),
        ]
    logged = [json.loads(line) for line in lines.getvalue().splitlines()]
    requests = [line for line in logged if line["event"] == "request"]
    assert [line["request_id"] for line in requests] == [answer.headers["x-request-id"] for answer in answers]
    assert [line["status"] for line in requests] == [200, 404, 201, 422]
    assert requests[0]["job_id"] == job_id
    assert [line["route"] for line in requests[:2]] == ["/jobs/{job_id}", "unmatched"]
    assert all({"level", "timestamp", "method", "took_ms"} <= set(line) for line in requests)
    assert "Erika" not in lines.getvalue()
    assert "127.0.0.1" not in "".join(json.dumps(line) for line in requests)


def test_lines_of_libraries_have_the_same_form(lines: io.StringIO) -> None:
    with structlog.contextvars.bound_contextvars(job_id="j1"):
        logging.getLogger("some.library").warning("look at %s", "this")
        logging.getLogger("httpx").info("not this")
    (line,) = [json.loads(text) for text in lines.getvalue().splitlines()]
    assert (line["event"], line["level"], line["job_id"]) == ("look at this", "warning", "j1")


def test_exceptions_are_logged_with_their_trace(lines: io.StringIO) -> None:
    try:
        raise RuntimeError("inside")
    except RuntimeError:
        structlog.get_logger("x").exception("went wrong")
    line = json.loads(lines.getvalue())
    assert "RuntimeError: inside" in line["exception"]


def test_a_flood_of_log_lines_displaces_no_others(lines: io.StringIO) -> None:
    log = structlog.get_logger("x")
    for number in range(5000):
        log.info("request", route="unmatched", status=401, stranger=True, took_ms=number)
        logging.getLogger("asyncio").error("accept failed for %s", number)
        log.info("job-ended", number=number)
    log.info("request", route="/jobs", status=401, stranger=True)
    logged = [json.loads(line) for line in lines.getvalue().splitlines()]
    count = Counter(str(line["event"]).split(" for ")[0] for line in logged)
    assert count["job-ended"] == 5000
    assert BURST <= count["accept failed"] <= BURST + 5
    assert BURST + 1 <= count["request"] <= BURST + 6


def test_a_line_says_how_many_like_it_were_left_out() -> None:
    now_s = [0.0]
    flood = RepeatedLineFilter(clock=lambda: now_s[0])

    def line(message: object) -> logging.LogRecord:
        return logging.LogRecord(
            "x", logging.WARNING, "", 0, message, ("arg",) if isinstance(message, str) else (), None
        )

    written = [flood.filter(line("about %s")) for _ in range(BURST + 7)]
    assert written == [True] * BURST + [False] * 7
    now_s[0] += 1.01 / RATE_HZ
    late = line("about %s")
    assert flood.filter(late)
    assert late.getMessage() == "about arg (7 like it left out)"
    assert not flood.filter(line("about %s"))
    other = line({"event": "another"})
    assert flood.filter(other)
    assert other.msg == {"event": "another"}


def test_an_unknown_level_is_refused() -> None:
    with pytest.raises(ValueError, match="log level"):
        configure_logging("loud")
