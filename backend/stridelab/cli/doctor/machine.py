"""``stridelab doctor``: checks of this machine, with a fix for each failure."""

import importlib
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable

import httpx
from pydantic import ValidationError

from stridelab.cli.doctor import service as parts
from stridelab.cli.doctor.checks import Check, nearest_existing_folder, print_checks
from stridelab.errors import InvalidInput, Unavailable
from stridelab.machine.models_folder import models_dir
from stridelab.service.postgres.paths import REMEDY, wheel_binaries
from stridelab.service.settings import Settings

PACKAGES = [
    "numpy",
    "scipy",
    "ezc3d",
    "pinocchio",
    "pyarrow",
    "fastapi",
    "uvicorn",
    "pydantic",
    "sqlalchemy",
    "alembic",
    "psycopg",
    "obstore",
    "casadi",
    "daqp",
    "mujoco",
    "sklearn",
    "trimesh",
    "fast_simplification",
    "example_robot_data",
    "viser",
    "jinja2",
    "plotly",
    "httpx",
    "structlog",
    "prometheus_client",
]
MIN_PYTHON, FIRST_UNTESTED_PYTHON = (3, 11), (3, 14)


def check_machine() -> bool:
    """Run and print all checks; returns whether all passed."""
    try:
        settings = Settings()
    except ValidationError as error:
        problems = "; ".join(f"STRIDELAB_{'_'.join(map(str, e['loc'])).upper()}: {e['msg']}" for e in error.errors())
        return print_checks([Check("settings", False, problems, "Correct or unset these environment variables.")])
    checks: tuple[Callable[[Settings], Check], ...] = (
        lambda _: check_python_version(sys.version_info[:2]),
        lambda _: check_packages(PACKAGES),
        lambda _: check_models(),
        check_database,
        parts.check_tables,
        parts.check_clock,
        parts.check_workers,
        check_data_folder,
        parts.check_storage,
        check_disk,
        parts.check_memory,
        parts.check_sandbox,
        parts.check_solver,
        check_port,
        check_network,
    )
    return print_checks([check(settings) for check in checks])


def report_service(url: str) -> bool:
    """Print and return whether the service at ``url`` is healthy."""
    return print_checks([check_service(url)])


def report_worker() -> bool:
    """Print and return whether the worker of the data folder has a recent heartbeat."""
    return print_checks([parts.check_heartbeat(Settings())])


def check_python_version(version: tuple[int, int]) -> Check:
    """Check that the project is tested with this version of Python."""
    ok = MIN_PYTHON <= version < FIRST_UNTESTED_PYTHON
    return Check("Python", ok, f"{version[0]}.{version[1]}", "Use Python 3.11 to 3.13.")


def check_packages(names: list[str] | tuple[str, ...]) -> Check:
    """Check that all packages can be imported."""
    missing: list[str] = []
    for name in names:
        try:
            importlib.import_module(name)
        except ImportError as error:
            missing.append(f"{name} ({error})")
    if not missing:
        return Check("packages", True, f"{len(names)} import")
    return Check(
        "packages", False, ", ".join(missing), "Install the lock file again: make serve, or pip install stridelab."
    )


def check_models() -> Check:
    """Check that the installation contains the data files."""
    try:
        folder = models_dir()
    except FileNotFoundError as error:
        return Check("models", False, str(error), "Install the whole distribution again.")
    return Check("models", True, str(folder))


def check_database(settings: Settings) -> Check:
    """Check that the configured PostgreSQL answers, or that the embedded binaries run."""
    try:
        url = settings.database_dsn
    except InvalidInput as error:
        return Check("database", False, error.message, "Make the file of STRIDELAB_DATABASE_PASSWORD_FILE readable.")
    if url:
        return _check_database_url(url)
    try:
        folder = settings.pg_bin or wheel_binaries()
        for program in ("initdb", "postgres"):
            answer = subprocess.run(
                [str(folder / program), "--version"], capture_output=True, text=True, timeout=10, check=True
            )
    except Unavailable:
        return Check("database", False, "no PostgreSQL binaries are installed", REMEDY)
    except (OSError, subprocess.SubprocessError) as error:
        return Check("database", False, f"{folder / program} does not run ({error})", REMEDY)
    return Check("database", True, f"embedded, {answer.stdout.strip()}")


def check_data_folder(settings: Settings) -> Check:
    """Check that the data folder is writable or can be created."""
    folder = settings.data_folder
    place = nearest_existing_folder(folder)
    try:
        with tempfile.NamedTemporaryFile(dir=place):
            pass
    except OSError as error:
        fix = f"Make {place} writable, or set STRIDELAB_DATA_DIR to a folder that is."
        return Check("data folder", False, f"{folder}: {error.strerror}", fix)
    return Check("data folder", True, str(folder) if place == folder else f"{folder} (will be created)")


def check_disk(settings: Settings) -> Check:
    """Check that more than STRIDELAB_MIN_FREE_DISK_MB is free for the data folder."""
    free_mb = shutil.disk_usage(nearest_existing_folder(settings.data_folder)).free / 1e6
    wanted = settings.min_free_disk_mb
    fix = f"Free {wanted} MB there, set STRIDELAB_DATA_DIR elsewhere, or lower STRIDELAB_MIN_FREE_DISK_MB."
    return Check("disk", free_mb > wanted, f"{free_mb:,.0f} MB free", fix)


def check_port(settings: Settings) -> Check:
    """Check that the port is free, or that a healthy service already uses it."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    where = f"{settings.host}:{settings.port}"
    try:
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((settings.host, settings.port))
    except OSError as error:
        if check_service(f"http://{where}").ok:
            return Check("port", True, f"{where} is in use by a healthy stridelab")
        return Check(
            "port",
            False,
            f"{where}: {error.strerror}",
            "Set STRIDELAB_PORT to a free port, or stop the program that uses it.",
        )
    return Check("port", True, f"{where} is free")


def check_network(settings: Settings) -> Check:
    """Check that an API token is set if the service listens beyond loopback."""
    if settings.is_loopback:
        return Check("network", True, "loopback only, no token needed")
    try:
        token = settings.token
    except InvalidInput as error:
        return Check("network", False, error.message, "Put the token into the file of STRIDELAB_API_TOKEN_FILE.")
    fix = "Set STRIDELAB_API_TOKEN or STRIDELAB_API_TOKEN_FILE; without one only loopback is served."
    return Check("network", bool(token), f"bound to {settings.host}, token {'set' if token else 'missing'}", fix)


def check_service(url: str) -> Check:
    """Check ``GET /api/v1/health`` of a service."""
    try:
        answer = httpx.get(f"{url.rstrip('/')}/api/v1/health", timeout=4.0)
        healthy = answer.status_code == httpx.codes.OK and answer.json().get("status") == "ok"
        detail = f"{url} answers {answer.status_code}"
    except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
        healthy, detail = False, f"{url} does not answer ({error})"
    return Check("service", healthy, detail, "Start it with: stridelab serve; if it runs, look into its log.")


def _check_database_url(url: str) -> Check:
    import psycopg

    fix = "Check STRIDELAB_DATABASE_URL: host, port, user, password and that the server accepts connections."
    try:
        with psycopg.connect(url, connect_timeout=5) as connection:
            server = f"PostgreSQL {connection.info.server_version // 10000} at {connection.info.host}"
    except psycopg.Error as error:
        return Check("database", False, str(error).strip().splitlines()[0], fix)
    return Check("database", True, server)
