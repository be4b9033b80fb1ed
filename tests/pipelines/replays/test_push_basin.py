"""Pushes of a motion: drawn as stated, replayed in parallel, and counted."""

import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from stridelab.errors import NotEstimable
from stridelab.pipelines.replays.push_basin import PushResult, _require_upright, draw_pushes, push_basin
from stridelab.schemas.receding import PushBasinInput, PushBasinSummary, PushBasinTask
from stridelab.service.kinds.push_basin.run import run
from support.command_line import RecordedProgress, quiet
from support.robots.plans import short_walk


def task(**asked: object) -> PushBasinTask:
    walk = short_walk()
    return PushBasinTask(scenario=walk, input=PushBasinInput.model_validate({"scenario": walk, **asked}))


def test_pushes_are_uniform_over_time_and_direction_and_follow_the_seed() -> None:
    pushes = draw_pushes(2000, 8.0, 30.0, seed=3)
    times = np.array([push.time_s for push in pushes])
    impulses = np.array([push.impulse_ns for push in pushes])
    assert np.linalg.norm(impulses, axis=1) == pytest.approx(30.0)
    assert not impulses[:, 2].any()
    assert (np.histogram(times, 8, (0.0, 8.0))[0] > 180).all()
    assert (np.histogram(np.arctan2(impulses[:, 1], impulses[:, 0]), 8, (-np.pi, np.pi))[0] > 180).all()
    assert draw_pushes(2000, 8.0, 30.0, seed=3) == pushes
    assert draw_pushes(2000, 8.0, 30.0, seed=4) != pushes
    assert draw_pushes(5, 8.0, 30.0, seed=3) == pushes[:5], "more pushes begin with the same ones"


def test_every_push_is_replayed_counted_and_tabulated(tmp_path: Path) -> None:
    """Weak pushes are survived, strong ones are not, and nothing is proved on 4 m of ground."""
    progress = RecordedProgress()
    weak = push_basin(task(speed_m_s=0.03, n=2, seed=1), quiet, processes=1)
    assert (weak.summary.survived, weak.summary.arrived, weak.summary.completed) == (2, 2, 2)
    outcome = run(task(speed_m_s=1.5, n=2, seed=1), tmp_path, progress)
    summary = PushBasinSummary.model_validate(outcome.summary)
    assert (summary.n, summary.survived, summary.proved_lost, summary.unexplained) == (2, 0, 0, 2)
    assert (summary.provable, summary.certified) == (True, True)
    assert summary.impulse_ns == pytest.approx(1.5 * 90.27, rel=1e-3)
    assert summary.survived_ci95[0] == pytest.approx(0.0, abs=1e-12)
    assert 0.3 < summary.survived_ci95[1] < 0.7
    table = pq.read_table(tmp_path / "pushes.parquet").to_pydict()
    assert table["outcome"] == ["unexplained", "unexplained"]
    assert summary.arrived == 0
    assert table["arrived"] == [False, False]
    assert table["direction_rad"] == pytest.approx([push.direction_rad for push in weak.pushes])
    assert all(push < fall for push, fall in zip(table["time_s"], table["fall_time_s"], strict=True))
    assert all("not proved" in reason for reason in table["reason"])
    assert (tmp_path / "pushes.csv").read_text().count("\n") == 3
    assert any("2 of 2" in message for message in progress.messages)


def test_a_motion_that_falls_by_itself_has_no_basin() -> None:
    still = PushResult(0.0, 0.0, 0, "survived", True, True, "", math.nan, 0.0, 0.0, 0.0)
    _require_upright(still)
    with pytest.raises(NotEstimable, match=r"after 2\.5 s") as refusal:
        _require_upright(PushResult(0.0, 0.0, 0, "unexplained", False, False, "", 2.5, 0.3, 0.0, 0.0))
    assert refusal.value.code == "replay-fell"
