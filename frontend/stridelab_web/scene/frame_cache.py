"""Cache of the packed frames of recently viewed plans."""

from collections import OrderedDict
from typing import Final

from stridelab.client import AsyncClient
from stridelab_web.scene.documents import Document

MAX_PLANS: Final = 8
"""Maximum number of cached plans; half a minute of TALOS takes a quarter of a megabyte."""


class FrameCache:
    """Least-recently-used cache of packed frames by document; each process has its own."""

    def __init__(self) -> None:
        self._packed: OrderedDict[Document, bytes] = OrderedDict()

    def store_frames(self, document: Document, packed: bytes) -> None:
        """Store ``packed``, and drop the least recently used frames."""
        self._packed[document] = packed
        self._packed.move_to_end(document)
        while len(self._packed) > MAX_PLANS:
            self._packed.popitem(last=False)

    async def cached_frames(self, client: AsyncClient, document: Document) -> bytes | None:
        """The cached frames of a plan, or None. Raises the client's errors if the caller may not read the plan."""
        packed = self._packed.get(document)
        if packed is not None:
            await client.result(document.id)
            self.store_frames(document, packed)
        return packed
