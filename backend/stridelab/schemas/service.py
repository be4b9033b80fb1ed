"""Schemas of the health and the settings of the service."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract

Language = Literal["en", "de", "fr", "ja"]
"""Languages of the pages."""


class Health(Contract):
    """Response of ``GET /health``; without a reachable database, the response is a problem with status 503."""

    status: Literal["ok"] = "ok"
    version: str
    database: Literal["ok"] = "ok"
    uptime_s: float
    sandbox: list[str] = Field(
        default_factory=list,
        description="kernel restrictions of processes that parse files: files, tcp-ports, system-calls",
    )


class ShownSetting(Contract):
    """A setting of the service for display: ``value`` is readable text, and never a secret."""

    name: str
    value: str
    meaning: str
    changed: bool
