"""The web application: middleware, routes, and the resources that are opened at start-up."""

import asyncio
import time
from collections.abc import AsyncIterator, Coroutine
from contextlib import aclosing, asynccontextmanager, suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import anyio
from fastapi import APIRouter, FastAPI
from sqlalchemy import exists, select
from sqlalchemy.ext.asyncio import AsyncEngine
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware

from stridelab import __version__
from stridelab.errors import Unavailable
from stridelab.robots.card import robot_names
from stridelab.schemas.jobs import FINAL_STATES
from stridelab.service.api import health, login, metrics, openapi, problems
from stridelab.service.api.dependencies import Parts
from stridelab.service.api.jobs import endpoints as jobs
from stridelab.service.api.live import endpoints as live_robots
from stridelab.service.api.live.rooms import LiveRooms
from stridelab.service.api.marker_sets import endpoints as marker_sets
from stridelab.service.api.middleware.authentication import AuthenticationMiddleware
from stridelab.service.api.middleware.lingering_close import LingeringCloseMiddleware
from stridelab.service.api.middleware.page_relay import PageRelayMiddleware, render_lists
from stridelab.service.api.middleware.request_context import RequestContextMiddleware
from stridelab.service.api.previews import endpoints as plans
from stridelab.service.api.previews.own_robots import OwnRobotPlanners
from stridelab.service.api.recordings import endpoints as recordings
from stridelab.service.api.robots import endpoints as robots
from stridelab.service.api.robots.cache import RobotCache
from stridelab.service.api.robots.children import FORK_SERVER_MODULES
from stridelab.service.api.scenarios import endpoints as scenarios
from stridelab.service.api.scenarios.stored_checks import StoredChecks
from stridelab.service.api.session_cookies import SigningKeys
from stridelab.service.api.stream import endpoints as stream
from stridelab.service.api.stream import marker_endpoints as marker_stream
from stridelab.service.api.stream.limits import StreamLimiter
from stridelab.service.api.stream.watching import LiveBoard
from stridelab.service.api.subjects import endpoints as subjects
from stridelab.service.api.terrains import endpoints as terrains
from stridelab.service.api.tokens import endpoints as access
from stridelab.service.auth.token_cache import TokenCache
from stridelab.service.jobs.notifications import JobNotifications
from stridelab.service.jobs.queue import DATABASE_UNAVAILABLE
from stridelab.service.jobs.store import JobStore
from stridelab.service.jobs.work_folder import WorkFolder
from stridelab.service.kinds.registry import KINDS, READING
from stridelab.service.processes import confinement
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.resident import PreviewProcess
from stridelab.service.samples import recording
from stridelab.service.samples import scenarios as bundled_scenarios
from stridelab.service.settings import Settings
from stridelab.service.storage.blobs import BlobStore
from stridelab.service.storage.database import database_url, make_engine
from stridelab.service.storage.tables import job

WEB_MODULE: Final = "stridelab.service.web_mount"
MAX_PARSERS: Final = 2
"""Maximum number of single uploads that are parsed at the same time; further ones wait."""
MAX_BATCHES: Final = 2
"""Maximum number of bulk uploads that are parsed at the same time, separate from single uploads: each takes minutes."""
MAX_ROBOT_READERS: Final = 2
"""Maximum number of robots that are read or whose cards are checked at the same time: each may take 90 s."""
MAX_TERRAIN_READERS: Final = 2
"""Maximum number of terrains that are read at the same time: each may take a minute."""
MAX_VALIDATIONS: Final = 2
"""Maximum number of scenarios that are validated at the same time."""
REST_S: Final = 5.0
"""The files of further robots are made once no job has run for this time: a first plan would take a third longer."""
REST_MAX_S: Final = 60.0
"""They are made after this time in any case."""

MAX_POSITION_AGE_S: Final = 1.0
"""Maximum age of the positions of waiting jobs."""

UNCOMPRESSED_TYPES: Final = (
    *DEFAULT_EXCLUDED_CONTENT_TYPES,
    *("application/octet-stream", "application/pdf", "application/vnd.apache.parquet", "application/x-npz"),
    *("model/gltf-binary", "text/csv"),
)
"""Media types that are sent as they are: compressed already, streams of events, and files whose download announces
its length."""


def create_app(settings: Settings, *, with_sample: bool = False, for_pages: bool = False) -> FastAPI:
    """Create the application. Resources are opened at start-up only, so generating the OpenAPI document is cheap.

    ``with_sample`` writes the bundled recording and scenarios to the database at start-up, as in production.
    ``for_pages`` prepares the rendering of pages in place of robots, for the second web server.
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with open_parts(settings) as parts:
            app.state.parts = parts
            if with_sample:
                await recording.seed_sample(parts.engine, parts.blobs)
                await bundled_scenarios.seed_scenarios(parts.engine)
            # the first in low-priority child processes, while the service already answers requests
            async with _run_in_background(render_lists(app) if for_pages else _warm_robots(parts, with_sample)):
                yield

    app = FastAPI(
        title="stridelab",
        version=__version__,
        lifespan=lifespan,
        openapi_url="/api/v1/openapi.json",
        docs_url=None,  # FastAPI's pages load their scripts from a CDN
        redoc_url=None,
        redirect_slashes=False,
        # FastAPI's spans contain client addresses and full URLs; the request context middleware creates its own
        telemetry={"tracing": False, "metrics": False, "logs": False, "auto_configure": False},
    )
    token = settings.token
    keys = None if token is None else SigningKeys.from_token(token)
    app.state.keys = keys
    problems.install_handlers(app)
    openapi.install_openapi(app)
    api = APIRouter(prefix="/api/v1")
    # routes are matched in this order, and job requests are the most frequent
    for part in (
        jobs,
        health,
        recordings,
        marker_sets,
        subjects,
        robots,
        scenarios,
        terrains,
        plans,
        stream,
        marker_stream,
        live_robots,
        access,
    ):
        api.include_router(part.router)
    api.include_router(access.public_router)
    app.include_router(api)
    app.include_router(metrics.router)
    app.include_router(login.router)
    if find_spec(WEB_MODULE) is not None:  # the web pages are installed; they are served on the same port
        import_module(WEB_MODULE).mount_web_app(app, settings)
    app.add_middleware(GZipMiddleware, minimum_size=1000, compresslevel=5, exclude_content_types=UNCOMPRESSED_TYPES)
    app.add_middleware(AuthenticationMiddleware, settings=settings, keys=keys)
    app.add_middleware(LingeringCloseMiddleware)
    app.add_middleware(RequestContextMiddleware)
    if settings.pages_url is not None:
        app.add_middleware(PageRelayMiddleware, pages_url=settings.pages_url)
    return app


async def _warm_robots(parts: Parts, with_sample: bool) -> None:
    if with_sample:
        # robots of the bundled scenarios come first
        names = dict.fromkeys((*bundled_scenarios.robots_by_frequency(), *robot_names()))
        await parts.robots.prepare_all(names, partial(await_idle_queue, parts.engine))


async def await_idle_queue(engine: AsyncEngine) -> None:
    """Return when no job has run or waited for ``REST_S``, or after ``REST_MAX_S``."""
    began_s = rests_since_s = time.monotonic()
    works = select(exists().where(job.c.state.not_in(FINAL_STATES)))
    while (now_s := time.monotonic()) - began_s < REST_MAX_S:
        with suppress(*DATABASE_UNAVAILABLE):
            async with engine.connect() as connection:
                if await connection.scalar(works):
                    rests_since_s = now_s
        if now_s - rests_since_s >= REST_S:
            return
        await asyncio.sleep(1.0)


@asynccontextmanager
async def _run_in_background(work: Coroutine[Any, Any, None]) -> AsyncIterator[None]:
    """Run ``work`` in the background for the lifetime of the context, then cancel it."""
    task = asyncio.create_task(work)
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


@asynccontextmanager
async def open_parts(settings: Settings) -> AsyncIterator[Parts]:
    """Open the resources that the endpoints share, for the lifetime of the context.

    Raises ``Unavailable`` (``database-not-configured``) without a database address, and the errors of
    ``confinement.begin``.
    """
    url = database_url(settings)
    if url is None:
        raise Unavailable(
            "database-not-configured",
            "STRIDELAB_DATABASE_URL is not set; `stridelab serve` starts one and sets it.",
        )
    engine = make_engine(url)
    try:
        blobs = BlobStore.from_url(settings.blob_address, settings.blob_options)
        validation_limiter = anyio.CapacityLimiter(MAX_VALIDATIONS)
        async with (
            _open_spool(settings) as spool,
            JobNotifications(url) as board,
            IsolatedPool(READING, settings.job_niceness) as pool,
            PreviewProcess(pool) as resident,
            PreviewProcess(pool) as bodies,
            # a separate pool, which is closed once all robots are prepared
            aclosing(
                RobotCache(
                    IsolatedPool(FORK_SERVER_MODULES, settings.job_niceness),
                    blobs,
                    spool,
                    settings.job_memory_mb,
                    engine=engine,
                )
            ) as robot_cache,
            aclosing(OwnRobotPlanners(pool, engine, blobs, spool)) as own_planners,
            aclosing(LiveRooms(pool, engine, blobs, spool, settings)) as rooms,
            aclosing(StoredChecks(bodies, own_planners, validation_limiter, robot_cache)) as stored_checks,
        ):
            yield Parts(
                settings=settings,
                engine=engine,
                blobs=blobs,
                store=JobStore(
                    engine,
                    KINDS,
                    queue_limit=settings.queue_limit,
                    user_queue_limit=settings.user_queue_limit,
                    max_position_age_s=MAX_POSITION_AGE_S,
                ),
                notifications=board,
                pool=pool,
                spool=spool,
                parsers=anyio.CapacityLimiter(MAX_PARSERS),
                batches=anyio.CapacityLimiter(MAX_BATCHES),
                robot_readers=anyio.CapacityLimiter(MAX_ROBOT_READERS),
                terrain_readers=anyio.CapacityLimiter(MAX_TERRAIN_READERS),
                validation_limiter=validation_limiter,
                tokens=TokenCache(engine),
                robots=robot_cache,
                resident=resident,
                stance_checker=bodies,
                own_planners=own_planners,
                stored_checks=stored_checks,
                streams=StreamLimiter(settings.stream_limit),
                live=LiveBoard(),
                rooms=rooms,
                started_at_s=time.monotonic(),
                closing=asyncio.Event(),
            )
    finally:
        await engine.dispose()


@asynccontextmanager
async def _open_spool(settings: Settings) -> AsyncIterator[Path]:
    """Create a private folder for incoming uploads and remove the folders that killed processes left behind.

    Child processes that parse uploads can access it. Raises the errors of ``confinement.begin``.
    """
    root = settings.data_folder / "spool"
    with WorkFolder(root) as own:
        files = own / "files"
        files.mkdir(mode=0o700)
        confinement.prepare_confinement(settings, settings.data_folder, root, own, files)
        yield files
