"""Settings: environment variables ``STRIDELAB_*``, all with defaults; secrets may come from a file.

``shown_settings`` lists the effective settings for display; of settings that may contain a secret, only whether they
are set.
"""

from functools import cache
from pathlib import Path
from typing import Final, Literal

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict

from stridelab.errors import Fault, InvalidInput
from stridelab.schemas.service import Language, ShownSetting
from stridelab.service.processes.priority import NICENESS

LOOPBACK = frozenset({"127.0.0.1", "::1", "localhost"})


class Settings(BaseSettings):
    """All settings and limits of the service; docs/settings.md lists them (checked by a test)."""

    model_config = SettingsConfigDict(env_prefix="STRIDELAB_", extra="ignore", frozen=True)

    host: str = Field(default="127.0.0.1", description="address the web server binds to")
    port: int = Field(default=8000, ge=1, le=65535, description="the one public port")
    data_dir: Path | None = Field(default=None, description="data folder; .data/<port> in the checkout by default")
    database_url: str | None = Field(default=None, description="PostgreSQL to use instead of the embedded one")
    database_password_file: Path | None = Field(default=None, description="file with the password of that PostgreSQL")
    blob_url: str | None = Field(
        default=None, description="storage of files: a folder (file:///...) or s3://bucket/prefix"
    )
    blob_credentials_file: Path | None = Field(
        default=None, description="file with address and keys of the object store, one name=value per line"
    )
    pg_bin: Path | None = Field(default=None, description="folder with initdb and pg_ctl to use instead of the wheel's")
    api_token: SecretStr | None = Field(default=None, description="token for every request; required beyond loopback")
    api_token_file: Path | None = Field(default=None, description="file with the API token")
    allowed_hosts: str = Field(default="", description="comma-separated host names accepted beside the bound address")
    max_upload_mb: int = Field(default=128, ge=1, description="largest upload in MB (10^6 bytes)")
    max_batch_mb: int = Field(default=1024, ge=1, description="largest bulk upload in MB, sent and unpacked")
    batch_answer_s: float = Field(
        default=60.0, ge=0, description="time after which a bulk upload continues as a job; 0: always a job"
    )
    estimate_uploads: bool = Field(
        default=False, description="estimate the centre of mass of every single upload, where a method is applicable"
    )
    min_free_disk_mb: int = Field(default=500, ge=0, description="uploads are refused when less disk is free")
    parse_timeout_s: float = Field(
        default=10.0, gt=0, description="processor time for parsing an upload; six times as much may elapse"
    )
    parse_memory_mb: int = Field(default=1024, ge=128, description="memory limit for parsing an upload")
    sandbox: Literal["auto", "required", "off"] = Field(
        default="auto",
        description="sandbox of processes that read files: supported layers, all layers or no start, or none",
    )
    child_user: str | None = Field(default=None, description="account of processes that read files, if started by root")
    worker_slots: int | None = Field(default=None, ge=1, description="jobs at a time per worker; cores - 1 by default")
    dask_url: str | None = Field(
        default=None,
        pattern=r"^tcp://[^/:@\s]+:\d{1,5}$",
        description="scheduler of a Dask cluster that computes the parts of sweeps, studies, benches and learning",
    )
    job_timeout_s: float = Field(default=600.0, gt=0, description="wall-clock limit of a job, unless its kind sets one")
    job_memory_mb: int = Field(default=3072, ge=128, description="memory limit of a job's process")
    job_niceness: int = Field(default=NICENESS, ge=0, le=19, description="niceness of the processes of jobs")
    job_max_attempts: int = Field(
        default=3, ge=1, description="starts of a job after which the death of its worker fails it"
    )
    storage_patience_s: float = Field(
        default=300.0, ge=0, description="how long a job waits for unavailable file storage or a full disk"
    )
    queue_limit: int = Field(default=200, ge=1, description="queued jobs above which a new one gets a 429")
    user_queue_limit: int = Field(default=0, ge=0, description="queued jobs of one user; 0 for no limit")
    user_storage_mb: int = Field(default=0, ge=0, description="MB of uploads and results of one user; 0 for no limit")
    rate_limit_hz: float = Field(
        default=300.0, ge=0, description="requests per second of one token, a tenth without a token; 0 for no limit"
    )
    connection_limit: int = Field(
        default=4000, ge=1, description="open connections of a web server process, less where fewer files may be open"
    )
    address_connection_limit: int = Field(
        default=256, ge=1, description="open connections of one address, proxies aside"
    )
    header_timeout_s: float = Field(default=10.0, gt=0, description="time for a client to send the head of a request")
    body_timeout_s: float = Field(
        default=20.0, gt=0, description="silence in the body of a request before it is closed"
    )
    keep_alive_s: int = Field(default=5, ge=1, description="idle time after which a keep-alive connection is closed")
    heartbeat_s: float = Field(default=5.0, gt=0, description="interval of a worker's heartbeats")
    stall_s: float = Field(default=20.0, gt=0, description="silence after which a worker counts as dead")
    event_retention_days: float = Field(default=7.0, gt=0, description="retention time of progress events")
    result_retention_days: float = Field(default=90.0, gt=0, description="retention time of finished jobs and results")
    audit_retention_days: float = Field(default=365.0, gt=0, description="retention time of the audit log")
    stream_limit: int = Field(default=8, ge=0, description="online streams at a time per web server process")
    stream_rate_hz: float = Field(default=2000.0, gt=0, description="maximum samples per second of one stream")
    stream_message_kb: int = Field(default=256, ge=1, description="largest message of a stream in kB (10^3 bytes)")
    stream_idle_s: float = Field(default=60.0, gt=0, description="silence after which a stream is closed")
    live_limit: int = Field(default=4, ge=0, description="live robots at a time per web server process")
    user_live_limit: int = Field(default=2, ge=0, description="live robots of one user; 0 for no limit")
    live_idle_s: float = Field(default=60.0, gt=0, description="time without a viewer after which a live robot ends")
    viewer_url: str | None = Field(default=None, description="loopback control address of the viewer process")
    pages_url: str | None = Field(default=None, description="loopback address of the web server that renders pages")
    viewer_scenes: int | None = Field(
        default=None, ge=1, description="3D scenes that may be open in all; by default as memory allows"
    )
    user_scenes: int = Field(default=16, ge=0, description="3D scenes one user may have open; 0 for no limit")
    lab_name: str = Field(default="", max_length=120, description="name of the laboratory on reports")
    lab_logo: Path | None = Field(default=None, description="PNG or SVG of at most 500 kB on reports")
    language: Language | None = Field(
        default=None, description="language of the pages: en, de, fr or ja; by default that of the browser"
    )
    otlp_url: str | None = Field(
        default=None, description="collector of OpenTelemetry traces (OTLP over HTTP), such as http://127.0.0.1:4318"
    )
    log_level: str = Field(default="info", description="debug, info, warning or error")
    log_files: bool = Field(default=True, description="logs of serve's programs go to files, else to standard output")

    @property
    def data_folder(self) -> Path:
        """The data folder, absolute."""
        folder = self.data_dir or Path(".data") / str(self.port)
        return folder.expanduser().resolve()

    @property
    def blob_address(self) -> str:
        """URL of the file storage."""
        return self.blob_url or (self.data_folder / "blobs").as_uri()

    @property
    def blob_options(self) -> dict[str, str]:
        """Address and keys of the object store from the credentials file; empty where there is none."""
        if self.blob_credentials_file is None:
            return {}
        variable = "STRIDELAB_BLOB_CREDENTIALS_FILE"
        lines = _read_secret(self.blob_credentials_file, variable).splitlines()
        pairs = [line.partition("=") for line in lines if line.strip() and not line.lstrip().startswith("#")]
        if not all(name.strip() and separator for name, separator, _ in pairs):
            raise _unreadable_secret(self.blob_credentials_file, variable, "a line is not of the form name=value")
        return {name.strip(): value.strip() for name, _, value in pairs}

    @property
    def token(self) -> str | None:
        """The API token, if one is set."""
        if self.api_token_file is not None:
            variable = "STRIDELAB_API_TOKEN_FILE"
            token = _read_secret(self.api_token_file, variable).strip()
            if not token or not token.isprintable():
                raise _unreadable_secret(self.api_token_file, variable, "it contains no token")
            return token
        return self.api_token.get_secret_value() or None if self.api_token else None

    @property
    def database_dsn(self) -> str | None:
        """Database URL including the password from the secret file; None for the embedded database."""
        if self.database_url is None or self.database_password_file is None:
            return self.database_url
        from sqlalchemy.engine import make_url  # slow to import, and a start with the embedded database has no need

        password = _read_secret(self.database_password_file, "STRIDELAB_DATABASE_PASSWORD_FILE").strip()
        return make_url(self.database_url).set(password=password).render_as_string(hide_password=False)

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach the service."""
        return self.host in LOOPBACK


def _read_secret(path: Path, variable: str) -> str:
    """The text of a secret's file. Raises ``InvalidInput`` (``secret-unreadable``)."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise _unreadable_secret(path, variable, error.strerror or str(error)) from error
    except UnicodeDecodeError as error:
        raise _unreadable_secret(path, variable, "it is not UTF-8 text") from error


def _unreadable_secret(path: Path, variable: str, reason: str) -> InvalidInput:
    message = f"{path}, which {variable} names, cannot be used: {reason}."
    return InvalidInput("secret-unreadable", message, [Fault(variable, reason)])


@cache
def current_settings() -> Settings:
    """The settings of this process."""
    return Settings()


SECRET_SETTINGS: Final = frozenset(
    {
        "api_token",
        "api_token_file",
        "database_url",
        "database_password_file",
        "blob_url",
        "blob_credentials_file",
        "otlp_url",
    }
)
"""Tokens, passwords, the files that hold them, and addresses that may carry them."""


def shown_settings(settings: Settings) -> tuple[ShownSetting, ...]:
    """Every setting with its value as text."""
    return tuple(
        ShownSetting(
            name=f"STRIDELAB_{name.upper()}",
            value=_value_text(name, getattr(settings, name)),
            meaning=field.description or "",
            changed=getattr(settings, name) != field.default,
        )
        for name, field in Settings.model_fields.items()
    )


def _value_text(name: str, value: object) -> str:
    if value is None or value == "":
        return "not set"
    if name in SECRET_SETTINGS:
        return "set, not shown"
    return f"{value:g}" if isinstance(value, float) else str(value)
