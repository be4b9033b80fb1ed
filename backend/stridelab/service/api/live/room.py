"""One live robot: its child process, its clock, and its viewers.

Simulated time follows real time times the requested pace. A child that is slower falls behind, and is not asked to
catch up: no step of the physics is skipped, and the state message says the pace that was reached.
"""

import asyncio
import secrets
from collections import deque
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, Final

import structlog

from stridelab.errors import Busy, StridelabError, Unavailable
from stridelab.schemas.live.messages import (
    LivePhase,
    LiveRefused,
    LiveRobot,
    LiveSession,
    LiveSet,
    LiveSettings,
    LiveState,
)
from stridelab.service.api.live.viewers import Viewer
from stridelab.service.api.problems import problem_of
from stridelab.service.processes.pool import ChildSession

TICK_S: Final = 0.02
"""Real time between two frames."""
BUDGET_S: Final = 0.1
"""Real time that a slow child may take for one frame."""
PLAN_S: Final = 300.0
MAX_VIEWERS: Final = 16
MAX_COMMANDS: Final = 400
"""Commands that may wait for the child: the burst that one viewer may send (``SampleRateLimiter``), four times."""
_STATE_S: Final = 1.0
_LOOK_S: Final = 0.25
_PACE_WINDOW_S: Final = 2.0
RETRY_S: Final = 10.0

OpenChild = Callable[[], AbstractAsyncContextManager[ChildSession]]
log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class LiveMotion:
    """What a session shows: the scenario with its id, or a level walk of the robot."""

    title: str
    robot: str
    scenario_id: str | None = None
    scenario: Mapping[str, Any] | None = None
    velocity: tuple[float, float, float] | None = None


class LiveRoom:
    """A live robot; ``run`` plans its motion and simulates it until it has had no viewer for ``idle_s``."""

    def __init__(self, motion: LiveMotion, owner: str | None, idle_s: float) -> None:
        self.session_id = secrets.token_hex(8)
        self.motion, self.owner = motion, owner
        self.phase: LivePhase = "planning"
        self._idle_s = idle_s
        self._viewers: list[Viewer] = []
        self._commands: list[tuple[Viewer, Mapping[str, Any]]] = []
        self._wake = asyncio.Event()
        self._state = LiveState(phase="planning", message="waiting for a process")
        self._fall: str | None = None
        self._frame: str | None = None
        self._paces: deque[tuple[float, float]] = deque()

    def describe(self) -> LiveSession:
        """The session as a list shows it."""
        return LiveSession(
            session_id=self.session_id,
            title=self.motion.title,
            robot=self.motion.robot,
            scenario_id=self.motion.scenario_id,
            phase=self.phase,
            n_watching=len(self._viewers),
            page=f"/live/robots/{self.session_id}",
            socket=f"/api/v1/live/{self.session_id}",
        )

    @contextmanager
    def watch(self, *, may_push: bool) -> Iterator[Viewer]:
        """A viewer for the duration of the context. Raises ``Busy`` (``too-many-watching``)."""
        if len(self._viewers) >= MAX_VIEWERS:
            raise Busy("too-many-watching", f"{MAX_VIEWERS} others watch this robot already, the limit.", RETRY_S)
        viewer = Viewer(may_push=may_push)
        self._viewers.append(viewer)
        self._publish_state()
        if self._frame is not None:
            viewer.show_frame(self._frame)
        if self._fall is not None:
            viewer.send_message(self._fall)
        self._wake.set()
        try:
            yield viewer
        finally:
            self._viewers.remove(viewer)
            self._publish_state()

    def command(self, viewer: Viewer, document: Mapping[str, Any]) -> None:
        """Carry out a validated command of ``viewer``. Raises ``Busy`` (``too-many-commands``)."""
        if len(self._commands) >= MAX_COMMANDS:
            raise Busy("too-many-commands", "Too many commands wait for this robot.", 1.0)
        self._commands.append((viewer, document))
        self._wake.set()

    async def run(self, open_child: OpenChild) -> None:
        """Plan and simulate in the child of ``open_child``."""
        try:
            async with open_child() as child:
                await self._plan(child)
                await self._simulate(child)
        except StridelabError as error:
            self.phase = "failed"
            self._update_state(message=error.message, problem=problem_of(error))
            while await self._is_watched():
                await asyncio.sleep(_LOOK_S)
        except Exception:
            log.exception("live session broke", session=self.session_id)
        finally:
            for viewer in self._viewers:
                viewer.end()

    async def _plan(self, child: ChildSession) -> None:
        loop, said_at = asyncio.get_running_loop(), 0.0

        def tell(fraction: float, message: str) -> None:
            nonlocal said_at
            if loop.time() - said_at > TICK_S:
                said_at = loop.time()
                self._update_state(fraction=fraction, message=message)

        motion = self.motion
        task = {"plan": {"robot": motion.robot, "scenario": motion.scenario, "velocity": motion.velocity}}
        value = await self._ask(child.run(task, answer_s=PLAN_S, on_progress=tell))
        self.phase = "running"
        self._show_frame(value["frame"])
        self._update_state(message="", fraction=1.0, robot=LiveRobot.model_validate(value["robot"]))

    async def _simulate(self, child: ChildSession) -> None:
        loop = asyncio.get_running_loop()
        due_s = said_s = loop.time()
        while await self._is_watched():
            moves = self.phase == "running" or (self.phase == "fallen" and not self._has_stopped)
            if not self._viewers or not (moves or self._commands):
                self._wake.clear()
                await _wait_for(self._wake, _LOOK_S)
                due_s = loop.time()
                self._paces.clear()
                continue
            await asyncio.sleep(max(0.0, due_s - loop.time()))
            began_s = loop.time()
            value = await self._advance(child, moves=moves)
            due_s = max(due_s + TICK_S, loop.time() - 2 * TICK_S)
            self._note_pace(began_s, value["advanced_s"])
            if value["commands"] or value["fall"] or loop.time() - said_s > _STATE_S:
                said_s = loop.time()
                self._update_state(
                    pace=self._pace(),
                    can_rewind_s=round(value["can_rewind_s"], 3),
                    settings=LiveSettings.model_validate(value["settings"]),
                )

    async def _advance(self, child: ChildSession, *, moves: bool) -> dict[str, Any]:
        """Carry out the waiting commands and the next piece of the simulation."""
        waiting, self._commands = self._commands, []
        for _, document in waiting:
            self._note_command(document)
        moves = moves and self.phase != "paused"
        advance_s = TICK_S * self._state.settings.pace if moves or self.phase == "running" else 0.0
        task = {"commands": [document for _, document in waiting], "advance_s": advance_s, "budget_s": BUDGET_S}
        value = await self._ask(child.run(task))
        for refusal in value["refusals"]:
            viewer = waiting[refusal["command"]][0]
            viewer.send_message(LiveRefused(code=refusal["code"], message=refusal["message"]).model_dump_json())
        self._has_stopped = bool(value["stopped"])
        if value["fallen"]:
            self.phase = "fallen"
        elif self.phase == "fallen":
            self.phase, self._fall = "running", None
        if value["fall"]:
            self._fall = value["fall"]
            for viewer in self._viewers:
                viewer.send_message(value["fall"])
        self._show_frame(value["frame"])
        return {**value, "commands": len(waiting)}

    _has_stopped = False

    def _note_command(self, document: Mapping[str, Any]) -> None:
        kind = document["type"]
        if kind == "pause" and self.phase == "running":
            self.phase = "paused"
        elif kind in ("resume", "restart") and self.phase == "paused":
            self.phase = "running"
        elif kind == "set":
            settings = LiveSet.model_validate(document).applied_to(self._state.settings)
            self._state = self._state.model_copy(update={"settings": settings})

    async def _ask(self, asking: Awaitable[Any]) -> dict[str, Any]:
        outcome = await asking
        if outcome.state == "ok":
            return dict(outcome.value)
        if outcome.error_class is not None:
            raise outcome.as_error()
        log.error("live session failed", state=outcome.state, log_tail=outcome.log_tail[-2000:])
        raise Unavailable("live-failed", "The simulation of this robot ended unexpectedly. Start a new one.")

    async def _is_watched(self) -> bool:
        """Whether somebody watches, or comes within the idle time."""
        waited_s = 0.0
        while not self._viewers:
            if waited_s >= self._idle_s:
                return False
            self._wake.clear()
            await _wait_for(self._wake, _LOOK_S)
            waited_s += _LOOK_S
        return True

    def _note_pace(self, at_s: float, advanced_s: float) -> None:
        self._paces.append((at_s, advanced_s))
        while self._paces[0][0] < at_s - _PACE_WINDOW_S:
            self._paces.popleft()

    def _pace(self) -> float | None:
        if len(self._paces) < 2 or self._paces[-1][0] - self._paces[0][0] < 0.5:
            return None
        (first_s, _), (last_s, last) = self._paces[0], self._paces[-1]
        return round((sum(advanced_s for _, advanced_s in self._paces) - last) / (last_s - first_s), 3)

    def _show_frame(self, frame: str) -> None:
        self._frame = frame
        for viewer in self._viewers:
            viewer.show_frame(frame)

    def _update_state(self, **changes: Any) -> None:
        self._state = self._state.model_copy(update=changes)
        self._publish_state()

    def _publish_state(self) -> None:
        state = self._state.model_copy(update={"phase": self.phase, "n_watching": len(self._viewers)})
        self._state = state
        for viewer in self._viewers:
            viewer.send_message(state.model_copy(update={"may_push": viewer.may_push}).model_dump_json())


async def _wait_for(event: asyncio.Event, timeout_s: float) -> None:
    try:
        await asyncio.wait_for(event.wait(), timeout_s)
    except TimeoutError:
        return
