"""A replay in a second process is that of this one, and its parts follow those of this process."""

import contextlib
import os
import subprocess
import sys
from multiprocessing import Pipe
from pathlib import Path

import numpy as np
import pytest

from stridelab.machine.cores import SINGLE_THREADED
from stridelab.robots.loader import load_robot
from stridelab.schemas.plans import PlanMotionInput
from stridelab.service.jobs.partial_results import CHUNK
from stridelab.service.kinds.partial_results import PARTIAL_FOLDER, chunk_name
from stridelab.service.kinds.plan_motion.replay_beside import ReplayBeside, ReplayInbox
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion, shared_zeros
from stridelab.wholebody.replay.replay import replay_with_defaults
from support.robots.plans import short_walk, sway

TESTS = Path(__file__).parents[3]
RUN_COMPARISON = """
import runpy, sys
from pathlib import Path
runpy.run_path(sys.argv[1])["compare_replays"](Path(sys.argv[2]))
"""


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="a second process needs a second core")
def test_a_replay_beside_the_body_is_that_of_the_whole_motion(tmp_path: Path) -> None:
    """In a process of its own: this one may have threads of tests before, with which it must not be forked."""
    command = [sys.executable, "-c", RUN_COMPARISON, __file__, str(tmp_path)]
    own = os.environ | SINGLE_THREADED | {"PYTHONPATH": str(TESTS)}
    result = subprocess.run(command, env=own, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "compared" in result.stdout


def compare_replays(tmp_path: Path) -> None:
    """A replay begins before the first sample, shows nothing before it may, and ends with its process."""
    assert ReplayBeside.is_possible()
    (tmp_path / PARTIAL_FOLDER).mkdir()
    robot, request = load_robot("talos"), PlanMotionInput(scenario=short_walk(), replay=True)
    plan = sway(robot, duration_s=0.5, amplitude_m=0.01, period_s=1.5)
    shown: list[float] = []
    with contextlib.ExitStack() as processes:
        begun: list[ReplayBeside] = []

        def begin(motion: WholeBodyMotion) -> None:
            begun.append(ReplayBeside(request, robot, motion, 0, tmp_path))
            processes.callback(begun[0].end_process)

        def tell(time_s: np.ndarray, _q: np.ndarray) -> None:
            begun[0].send_samples(round(time_s[-1] * 250.0) + 1)

        motion = WholeBodyController().run(robot, plan.sequence, plan, None, tell, begin, shared_zeros)
        assert list((tmp_path / PARTIAL_FOLDER).iterdir()) == []
        begun[0].show_parts(7)
        replay, files = begun[0].wait_for_replay(lambda fraction, _message: shown.append(fraction))
    alone = replay_with_defaults(robot, motion.sequence, motion, lambda _fraction, _message: None)
    np.testing.assert_array_equal(replay.q, alone.q)
    np.testing.assert_array_equal(replay.v, alone.v)
    assert replay.completed == alone.completed
    assert sorted(file.name for file in files) == sorted(
        path.name for path in tmp_path.iterdir() if path.name != PARTIAL_FOLDER
    )
    with np.load(tmp_path / "replay.npz") as arrays:
        np.testing.assert_array_equal(arrays["q"], alone.q)
    assert shown == sorted(shown)
    names = sorted(path.name for path in (tmp_path / PARTIAL_FOLDER).iterdir())
    assert names == [chunk_name(7 + k) for k in range(len(names))]
    times_s = [t for name in names for t in CHUNK.validate_json((tmp_path / PARTIAL_FOLDER / name).read_bytes()).time_s]
    assert times_s == sorted(times_s)
    assert len(times_s) == pytest.approx(25 * float(replay.time_s[-1]), abs=2)
    print("compared")


def test_messages_that_were_read_while_a_part_was_written_are_not_waited_for() -> None:
    """The sender is closed: waiting for a further message is an ``EOFError``."""
    inbox, outbox = Pipe(duplex=False)
    received = ReplayInbox(inbox, 50)
    assert received.released_part() == 0
    for message in (("samples", 100), ("samples", 200)):
        outbox.send(message)
    assert received.released_part() == 0
    assert received.wait_for_samples() == 200
    for message in (("parts", 7), ("samples", 300)):
        outbox.send(message)
    outbox.close()
    assert received.wait_for_samples() == 300
    written: list[int] = []

    def write() -> bool:
        written.append(received.first_part)
        return True

    received.wait_for_release(write)
    assert written == [7]
    with pytest.raises(EOFError):
        received.wait_for_samples()
