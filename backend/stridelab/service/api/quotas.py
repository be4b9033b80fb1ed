"""Storage quota per user."""

from sqlalchemy import BigInteger, cast, func, select

from stridelab.errors import TooLarge
from stridelab.service.api.dependencies import Parts
from stridelab.service.storage.tables import job, recording, robot


async def refuse_full(parts: Parts, owner: str | None, more_bytes: int = 0) -> None:
    """Raise ``TooLarge`` (``storage-limit``) if uploads and results of ``owner`` and ``more_bytes`` reach the limit.

    The check takes no lock, so two simultaneous requests may both pass and exceed the limit slightly.
    """
    limit_mb = parts.settings.user_storage_mb
    if owner is None or limit_mb == 0:
        return
    uploads = select(func.coalesce(func.sum(recording.c.bytes), 0)).where(recording.c.owner == owner)
    files = func.jsonb_array_elements(job.c.result["artifacts"]).table_valued("value")
    size = cast(files.c.value.op("->>")("bytes"), BigInteger)
    results = select(func.coalesce(func.sum(size), 0)).select_from(job).join(files, onclause=job.c.owner == owner)
    robots = select(func.coalesce(func.sum(robot.c.bytes), 0)).where(robot.c.owner == owner)
    async with parts.engine.connect() as connection:
        used = sum([int((await connection.execute(query)).scalar_one()) for query in (uploads, robots, results)])
    if used + more_bytes >= limit_mb * 1_000_000:
        raise TooLarge(
            "storage-limit",
            f"You store {used / 1e6:.1f} MB, and {limit_mb} MB is the limit for one user; delete something first.",
        )
