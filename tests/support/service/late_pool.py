"""A pool whose imports wait for its first task: they cost seconds, and most tests send nothing that is read."""

from stridelab.service.processes.pool import IsolatedPool


class LatePool(IsolatedPool):
    """Starts with its first task what the service starts with itself."""

    async def __aenter__(self) -> "LatePool":  # noqa: PYI034 (as its parent)
        return self
