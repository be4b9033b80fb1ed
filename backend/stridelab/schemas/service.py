"""The service about itself."""

from typing import Literal

from pydantic import Field

from stridelab.schemas.base import Contract


class Health(Contract):
    """``GET /health``; anything but a reachable database is answered 503 with a problem."""

    status: Literal["ok"] = "ok"
    version: str
    database: Literal["ok"] = "ok"
    uptime_s: float
    sandbox: list[str] = Field(
        default_factory=list,
        description="what the kernel takes from processes that read files: files, tcp-ports, system-calls",
    )


class ShownSetting(Contract):
    """A setting of the service as people may see it: ``value`` is in words, and never a secret."""

    name: str
    value: str
    meaning: str
    changed: bool
