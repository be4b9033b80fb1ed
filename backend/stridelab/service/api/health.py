"""``GET /health``."""

import time

from fastapi import APIRouter
from sqlalchemy import text

from stridelab import __version__
from stridelab.schemas.service import Health
from stridelab.service.api.dependencies import AppParts
from stridelab.service.processes.confinement import active_layers

router = APIRouter(tags=["service"])


@router.get("/health", summary="Health")
async def health(parts: AppParts) -> Health:
    """Report whether the service and its database respond. Requires no login."""
    async with parts.engine.connect() as connection:
        await connection.execute(text("SELECT 1 FROM job LIMIT 1"))
    uptime_s = round(time.monotonic() - parts.started_at_s, 1)
    return Health(version=__version__, uptime_s=uptime_s, sandbox=list(active_layers(parts.settings)))
