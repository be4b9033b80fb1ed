"""The scenes that are open: one viser server per document, the least used closed first."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import viser

from stridelab.schemas.recordings import Recording
from stridelab_web.frames import Frames
from stridelab_web.viewer import scene
from stridelab_web.viewer.guard import start_guarded_server

SCENES_AT_MOST = 8
IDLE_S = 600.0


@dataclass(frozen=True)
class Document:
    """What a scene shows: a recording and, where one is chosen, the result of a job."""

    recording_id: str
    job_id: str | None


@dataclass
class OpenScene:
    """A running viser server; ``recording`` is what it was built from."""

    server: viser.ViserServer
    secret: str
    recording: Recording
    used_at_s: float

    @property
    def port(self) -> int:
        return int(self.server.get_port())


class Library:
    """Opens scenes on demand and closes those that nobody looks at."""

    def __init__(
        self,
        look_up: Callable[[Document], Recording],
        load: Callable[[Document, Recording], Frames],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._look_up = look_up
        self._load = load
        self._clock = clock
        self._lock = threading.Lock()
        self._open: OrderedDict[Document, OpenScene] = OrderedDict()

    def __len__(self) -> int:
        return len(self._open)

    def open(self, document: Document) -> OpenScene:
        """The scene of ``document``, built if it is not open or if its recording has changed since.

        Raises the client's errors where the service refuses or does not answer.
        """
        recording = self._look_up(document)
        with self._lock:
            found = self._open.get(document)
            if found is not None and found.recording != recording:
                self._close(document)
                found = None
            if found is None:
                frames = self._load(document, recording)
                server, secret = start_guarded_server()
                scene.build(server, recording, frames)
                found = self._open[document] = OpenScene(server, secret, recording, 0.0)
            found.used_at_s = self._clock()
            self._open.move_to_end(document)
            for oldest in list(self._open)[:-SCENES_AT_MOST]:
                self._close(oldest)
            return found

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
