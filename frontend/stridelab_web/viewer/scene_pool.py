"""The scenes that are open: one viser server per document.

When a limit is reached, the least recently used scene is closed; scenes with a connected browser stay open.
"""

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import viser

from stridelab_web.scene.documents import Document, DocumentKind, PlayerForm
from stridelab_web.viewer.access_guard import start_guarded_server, users_of
from stridelab_web.viewer.scene_builders import Kind, Live
from stridelab_web.viewer.scene_limits import SceneLimits, ScenesInUse

IDLE_S = 600.0
COMING_S = 30.0
"""Time for which a requested scene waits for its browser before it counts as idle."""
CONNECTING_S = 2.0
"""Time for which viser may not list an accepted browser yet."""
LOCK_COUNT = 16


@dataclass
class Visitors:
    """Users of a scene, and those whose browsers are about to connect; times are those of ``clock``."""

    clock: Callable[[], float]
    users: set[str] = field(default_factory=set)
    coming_until_s: dict[str, float] = field(default_factory=dict)

    def expect_browser(self, user: str) -> None:
        """A browser of ``user`` is about to connect."""
        self.coming_until_s[user] = self.clock() + COMING_S

    def browser_accepted(self, user: str) -> None:
        """A browser of ``user`` was accepted: shortly afterwards it counts as connected."""
        self.coming_until_s[user] = self.clock() + CONNECTING_S

    def expected_users(self) -> set[str]:
        """Users whose browsers are about to connect."""
        now_s = self.clock()
        return {user for user, until_s in list(self.coming_until_s.items()) if now_s < until_s}


@dataclass
class OpenScene:
    """A running viser server; ``source`` is its content, ``live`` updates scenes that can be updated."""

    server: viser.ViserServer
    secret: str
    source: Any
    visitors: Visitors
    live: Live | None = None
    used_at_s: float = 0.0

    @property
    def port(self) -> int:
        return int(self.server.get_port())

    @property
    def refusal(self) -> str:
        """Why the last change from within the scene was refused; else empty."""
        return self.live.refusal if self.live is not None else ""

    def shows_source(self, source: Any) -> bool:
        """Whether the scene shows ``source``; live scenes are updated first."""
        return self.source == source if self.live is None else self.live.show_source(source)

    def opened_by(self, user: str) -> None:
        """``user`` opens the scene; unless connected, a browser of the user is expected."""
        self.used_at_s = self.visitors.clock()
        self.visitors.users.add(user)
        if user not in users_of(self.server):
            self.visitors.expect_browser(user)

    @property
    def watchers(self) -> set[str]:
        """Users with a browser that is connected, or about to be."""
        return {*users_of(self.server), *self.visitors.expected_users()}


class ScenePool:
    """Opens scenes on demand and closes idle ones."""

    def __init__(
        self,
        kinds: Mapping[DocumentKind, Kind],
        limits: SceneLimits,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._kinds = kinds
        self._limits = limits
        self._clock = clock
        self._lock = threading.Lock()
        self._turns = tuple(threading.Lock() for _ in range(LOCK_COUNT))
        self._open: dict[Document, OpenScene] = {}
        self._built: dict[Document, str] = {}
        """Users of the scenes that are being built, which count towards the limits."""
        self._filming = threading.Lock()

    def __len__(self) -> int:
        return len(self._open)

    def open_scene(self, document: Document, user: str = "") -> OpenScene:
        """The scene of ``document``, built if it is not open or cannot show what has changed since.

        ``user`` is the caller, empty without login. Raises ``ScenesInUse`` if a limit is reached and all scenes
        concerned are watched, and the client's errors if the service refuses or does not answer.
        """
        kind = self._kinds[document.kind]
        # What takes long to read must not keep other scenes waiting, but no scene is built twice at once.
        with self._turns[hash(document) % len(self._turns)]:
            source = kind.look_up(document)
            with self._lock:
                scene = self._open.get(document)
                self._make_room(document, user, is_new=scene is None)
                if scene is not None and not scene.shows_source(source):
                    self._close_scene(document)
                    scene = None
                if scene is not None:
                    scene.opened_by(user)
                    return scene
                self._built[document] = user
            try:
                scene = _build_scene(kind, document, source, Visitors(self._clock))
                with self._lock:
                    self._open[document] = scene
                    scene.opened_by(user)
            finally:
                with self._lock:
                    del self._built[document]
            return scene

    def _make_room(self, document: Document, user: str, *, is_new: bool) -> None:
        """Close idle scenes until ``document`` fits; the lock is held. Raises ``ScenesInUse``."""
        own = {each: scene for each, scene in self._open.items() if user in scene.visitors.users}
        own.pop(document, None)
        building = sum(whose == user for whose in self._built.values())
        while user and 0 < self._limits.per_user <= len(own) + building:
            unwatched = [each for each, scene in own.items() if user not in scene.watchers]
            if not unwatched:
                raise ScenesInUse("user", self._limits.per_user)
            oldest = min(unwatched, key=lambda each: own[each].used_at_s)
            scene = own.pop(oldest)
            scene.visitors.users.remove(user)
            if not scene.visitors.users and not scene.watchers:  # else it stays open for the others
                self._close_scene(oldest)
        while is_new and len(self._open) + len(self._built) >= self._limits.total:
            idle = [each for each, scene in self._open.items() if not scene.watchers]
            if not idle:
                raise ScenesInUse("total", self._limits.total)
            self._close_scene(min(idle, key=lambda each: self._open[each].used_at_s))

    def record_player(self, document: Document, form: PlayerForm) -> bytes:
        """The document as a file for viser's own player, made in a server of its own, one at a time.

        Raises ``KeyError`` for kinds without recordings, and the client's errors.
        """
        kind = self._kinds[document.kind]
        if kind.record is None:
            raise KeyError(document.kind)
        source = kind.look_up(document)
        with self._filming:
            server, _ = start_guarded_server()
            try:
                serializer = kind.record(server, document, source)
                return serializer.serialize() if form == "viser" else serializer.as_html().encode()
            finally:
                server.stop()

    def close_idle(self) -> None:
        """Close scenes without a viewer for ``IDLE_S``."""
        now_s = self._clock()
        with self._lock:
            for document, scene in list(self._open.items()):
                if scene.watchers:
                    scene.used_at_s = now_s
                elif now_s - scene.used_at_s > IDLE_S:
                    self._close_scene(document)

    def close_all(self) -> None:
        """Close everything."""
        with self._lock:
            for document in list(self._open):
                self._close_scene(document)

    def _close_scene(self, document: Document) -> None:
        self._open.pop(document).server.stop()


def _build_scene(kind: Kind, document: Document, source: Any, visitors: Visitors) -> OpenScene:
    server, secret = start_guarded_server(visitors.browser_accepted)
    try:
        return OpenScene(server, secret, source, visitors, kind.build(server, document, source))
    except BaseException:
        server.stop()
        raise
