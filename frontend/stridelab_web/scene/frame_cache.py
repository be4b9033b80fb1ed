"""The packed frames of the plans that were looked at last."""

from collections import OrderedDict
from typing import Final

from stridelab.client import AsyncClient
from stridelab_web.scene.documents import Document

PLANS_AT_MOST: Final = 8
"""A quarter of a megabyte for half a minute of TALOS."""


class KeptFrames:
    """Frames by document. Each process has its own: what is kept is only what would be packed anew."""

    def __init__(self) -> None:
        self._packed: OrderedDict[Document, bytes] = OrderedDict()

    def keep(self, document: Document, packed: bytes) -> None:
        """Keep ``packed``, and let go of what was asked for longest ago."""
        self._packed[document] = packed
        self._packed.move_to_end(document)
        while len(self._packed) > PLANS_AT_MOST:
            self._packed.popitem(last=False)

    async def of(self, client: AsyncClient, document: Document) -> bytes | None:
        """What is kept of a plan, or None; raises the client's errors where its visitor may not see the plan now."""
        found = self._packed.get(document)
        if found is not None:
            await client.result(document.id)
            self.keep(document, found)
        return found
