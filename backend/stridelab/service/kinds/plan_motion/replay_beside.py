"""The replay of a motion in a second process, which begins while the motion is being computed.

    this process     body                     certificate    waits
    the second one      replay, behind the body ..................... its files

Both share the memory of the motion; messages through a pipe carry the number of samples that are there. The parts that
the second process writes follow those of this one, and are therefore held back until the last of these is written.
"""

from collections.abc import Callable
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import BaseModel

from stridelab.machine.cores import usable_cores
from stridelab.machine.parallel import WorkBeside
from stridelab.pipelines.plan_motion import motion_progress, replay_motion
from stridelab.pipelines.progress import ProgressCallback
from stridelab.robots.robot import Robot
from stridelab.schemas.plans import PlanMotionInput
from stridelab.service.kinds.base import ArtifactFile
from stridelab.service.kinds.partial_results import PartialWriter
from stridelab.service.kinds.plan_motion.files import write_replay_data
from stridelab.service.kinds.plan_motion.partial_plan import PartialPlanWriter
from stridelab.wholebody.motion import MotionArrival, WholeBodyMotion, shared_zeros

if TYPE_CHECKING:
    from stridelab.wholebody.replay.replay import Replay

BEGINS_AFTER_S: Final = 2.0
"""Part of a motion after which its replay begins."""
_ASK_S: Final = 0.1
"""Interval between reports of progress."""
_SAMPLES, _PARTS = "samples", "parts"


class ReplayBeside:
    """The replay of ``motion`` for ``request``; its arrays, in shared memory, have ``arrived`` samples so far.

    Parts and files go to ``folder``. ``end_process`` has to be called.
    """

    def __init__(
        self, request: PlanMotionInput, robot: Robot, motion: WholeBodyMotion, arrived: int, folder: Path
    ) -> None:
        self._request, self._robot, self._motion, self._folder = request, robot, motion, folder
        self._fraction = shared_zeros((1,))
        inbox, self._outbox = Pipe(duplex=False)
        self._inbox = ReplayInbox(inbox, arrived)
        self._work = WorkBeside(self._run_replay)
        inbox.close()

    @staticmethod
    def is_possible() -> bool:
        """Whether this process may use a second core and can fork."""
        return usable_cores() > 1 and WorkBeside.is_possible()

    def send_samples(self, arrived: int) -> None:
        """Send the number of samples that there are."""
        self._send(_SAMPLES, arrived)

    def show_parts(self, number: int) -> None:
        """Let the process write its parts, the first one with this number; this process writes no more."""
        self._send(_PARTS, number)

    def wait_for_replay(self, progress: ProgressCallback) -> "tuple[Replay, tuple[ArtifactFile, ...]]":
        """The replay and what ``write_replay_data`` wrote of it.

        Raises as ``replay_motion``, and as ``WorkBeside.wait_for_result``.
        """
        report = motion_progress(progress, self._motion.sequence.duration_s)
        while not self._work.ends_within(_ASK_S):
            report(float(self._fraction[0]), "")
        return self._work.wait_for_result()

    def end_process(self) -> None:
        """End the process, whatever it does."""
        self._work.end_process()
        self._outbox.close()

    def _send(self, kind: str, number: int) -> None:
        try:
            self._outbox.send((kind, number))
        except OSError:
            return  # the process has ended: waiting for its result says why

    def _run_replay(self) -> "tuple[Replay, tuple[ArtifactFile, ...]]":
        """Replay the motion, in the second process."""
        self._outbox.close()
        inbox = self._inbox
        arrival = MotionArrival(len(self._motion.time_s), inbox.arrived, inbox.wait_for_samples)
        parts = _HeldParts(self._folder, inbox.released_part)
        watcher = PartialPlanWriter(parts, self._robot)
        motion = replace(self._motion, arrival=arrival)
        replay = replay_motion(self._request, self._robot, motion, self._note_progress, watcher)
        watcher.flush_replay()
        files = write_replay_data(self._folder, self._robot, self._motion, replay)
        inbox.wait_for_release(parts.write_held)
        return replay, files

    def _note_progress(self, fraction: float, _message: str) -> None:
        self._fraction[0] = fraction


class ReplayInbox:
    """What the second process has received: ``arrived`` samples, and ``first_part``, its number or 0."""

    def __init__(self, connection: Connection, arrived: int) -> None:
        self._connection = connection
        self.arrived, self.first_part, self._returned = arrived, 0, arrived

    def wait_for_samples(self) -> int:
        """The number of samples, when it is larger than the one that this returned before."""
        while self.arrived <= self._returned:  # it may have been read while a part was written
            self._read_message()
        self._returned = self.arrived
        return self.arrived

    def released_part(self) -> int:
        """The number of the first part, or 0; does not wait."""
        while self._connection.poll():
            self._read_message()
        return self.first_part

    def wait_for_release(self, write: Callable[[], bool]) -> None:
        """Wait for the number of the first part, unless ``write`` returns that there is nothing to write."""
        while not write():
            self._read_message()

    def _read_message(self) -> None:
        kind, number = self._connection.recv()
        if kind == _SAMPLES:
            self.arrived = number
        else:
            self.first_part = number


class _HeldParts(PartialWriter):
    """Holds parts until ``released`` returns the number of the first one."""

    def __init__(self, folder: Path, released: Callable[[], int]) -> None:
        super().__init__(folder)
        self._released = released
        self._held: list[BaseModel] = []

    def write(self, chunk: BaseModel) -> None:
        """Write the part, or hold it."""
        self._held.append(chunk)
        self.write_held()

    def write_held(self) -> bool:
        """Write what is held, if it may be written; whether nothing is held any more."""
        first = self._released()
        if first > 0:
            self.next_number = max(self.next_number, first)
            for chunk in self._held:
                super().write(chunk)
            self._held.clear()
        return not self._held
