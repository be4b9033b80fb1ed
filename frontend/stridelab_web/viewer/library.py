"""The scenes that are open: one viser server per document, the least used closed first."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import viser

from stridelab_web.documents import Document, DocumentKind, PlayerForm
from stridelab_web.viewer.guard import start_guarded_server
from stridelab_web.viewer.kinds import Kind, Live

SCENES_AT_MOST = 8
IDLE_S = 600.0
TURNS = 16


@dataclass
class OpenScene:
    """A running viser server; ``source`` is what it shows, ``live`` follows it where the scene can."""

    server: viser.ViserServer
    secret: str
    source: Any
    live: Live | None = None
    used_at_s: float = 0.0

    @property
    def port(self) -> int:
        return int(self.server.get_port())

    @property
    def said(self) -> str:
        """Why the last change from within the scene was refused; empty where it was not."""
        return self.live.said if self.live is not None else ""

    def shows(self, source: Any) -> bool:
        """Whether the scene shows ``source``; one that changes from within is told in any case."""
        return self.source == source if self.live is None else self.live.follow(source)


class Library:
    """Opens scenes on demand and closes those that nobody looks at."""

    def __init__(
        self,
        kinds: Mapping[DocumentKind, Kind],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._kinds = kinds
        self._clock = clock
        self._lock = threading.Lock()
        self._turns = tuple(threading.Lock() for _ in range(TURNS))
        self._open: OrderedDict[Document, OpenScene] = OrderedDict()
        self._filming = threading.Lock()

    def __len__(self) -> int:
        return len(self._open)

    def open(self, document: Document) -> OpenScene:
        """The scene of ``document``, built if it is not open or cannot show what has changed since.

        Raises the client's errors where the service refuses or does not answer.
        """
        kind = self._kinds[document.kind]
        # What takes long to read must not keep other scenes waiting, but no scene is built twice at once.
        with self._turns[hash(document) % len(self._turns)]:
            source = kind.look_up(document)
            with self._lock:
                found = self._open.get(document)
                if found is not None and not found.shows(source):
                    self._close(document)
                    found = None
            if found is None:
                found = _build(kind, document, source)
            with self._lock:
                self._open[document] = found
                found.used_at_s = self._clock()
                self._open.move_to_end(document)
                for oldest in list(self._open)[:-SCENES_AT_MOST]:
                    self._close(oldest)
            return found

    def record(self, document: Document, form: PlayerForm) -> bytes:
        """The document as a file for viser's own player, made in a server of its own, one at a time.

        Raises ``KeyError`` for a kind that has none, and the client's errors.
        """
        kind = self._kinds[document.kind]
        if kind.record is None:
            raise KeyError(document.kind)
        source = kind.look_up(document)
        with self._filming:
            server, _ = start_guarded_server()
            try:
                told = kind.record(server, document, source)
                return told.serialize() if form == "viser" else told.as_html().encode()
            finally:
                server.stop()

    def close_idle(self) -> None:
        """Close scenes without a viewer for ``IDLE_S``."""
        now_s = self._clock()
        with self._lock:
            for document, found in list(self._open.items()):
                if found.server.get_clients():
                    found.used_at_s = now_s
                elif now_s - found.used_at_s > IDLE_S:
                    self._close(document)

    def close(self) -> None:
        """Close everything."""
        with self._lock:
            for document in list(self._open):
                self._close(document)

    def _close(self, document: Document) -> None:
        self._open.pop(document).server.stop()


def _build(kind: Kind, document: Document, source: Any) -> OpenScene:
    server, secret = start_guarded_server()
    try:
        return OpenScene(server, secret, source, kind.build(server, document, source))
    except BaseException:
        server.stop()
        raise
