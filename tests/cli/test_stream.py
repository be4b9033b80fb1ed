"""``stridelab stream`` replays the shipped sample to a real service."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from stridelab.cli.options import EstimateRequest, Estimation, Walk
from stridelab.cli.stream import (
    COLUMNS,
    FRAME_COLUMNS,
    Replay,
    ReplayResult,
    pace_blocks,
    prepare_samples,
    stream_frames,
    stream_samples,
)
from stridelab.errors import InvalidInput, Unavailable
from stridelab.schemas.streams import StreamEstimate
from support.command_line import SAMPLE
from support.service.database import TestDatabases
from support.service.streams import walk_samples
from support.service.web_server import Served, served

REQUEST = EstimateRequest(Walk(SAMPLE / "recording.c3d"))


@pytest.fixture(scope="module")
def service(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data")) as running:
        yield running


def test_the_sample_is_replayed(service: Served, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "com.csv"
    replay = Replay(speed=4.0, block=20, packed=True, csv=path)
    stream_samples(REQUEST, replay, as_json=True, server=service.base_url, token=None)
    figures = json.loads(capsys.readouterr().out)
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    estimates = np.array(rows, dtype=float)
    assert tuple(header) == COLUMNS
    assert len(estimates) == figures["samples"]
    assert figures["method"] == "complementary"
    assert figures["played_s"] >= (estimates[-1, 0] - estimates[0, 0]) / 4.0 - 0.01
    _, samples = prepare_samples(REQUEST, Replay(packed=True))
    geometry = np.array([sample.geometry_m for sample in samples])
    assert estimates[:, 0] == pytest.approx([sample.time_s for sample in samples], abs=1e-5)
    assert np.abs(estimates[:, 1:4] - geometry).max() < 0.05
    assert np.abs(estimates[:, 1:3] - geometry[:, :2]).max() > 0.0, "the force says something"


def test_the_summary_is_a_table(service: Served, capsys: pytest.CaptureFixture[str]) -> None:
    stream_samples(REQUEST, Replay(speed=1000.0, block=50), as_json=False, server=service.base_url, token=None)
    output = capsys.readouterr().out
    for name in ("method", "played", "answered", "last position", "its band"):
        assert name in output


def test_the_smoother_is_selected_by_name(service: Served, capsys: pytest.CaptureFixture[str]) -> None:
    replay = Replay(method="smoother", ahead="1,0", speed=1000.0, block=50)
    stream_samples(REQUEST, replay, as_json=True, server=service.base_url, token=None)
    assert json.loads(capsys.readouterr().out)["method"] == "smoother"


@pytest.mark.parametrize(
    ("replay", "code", "where"),
    [
        (Replay(method="smoother", ahead="0,0"), "option-invalid", "--ahead"),
        (Replay(method="smoother", ahead="east"), "option-invalid", "--ahead"),
        (Replay(method="magic"), "option-invalid", "method"),
    ],
)
def test_a_senseless_method_or_direction_is_refused_before_anything_is_sent(
    replay: Replay, code: str, where: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        prepare_samples(REQUEST, replay)
    assert refused.value.code == code
    assert where in [fault.where for fault in refused.value.faults]


def test_an_unreachable_service_is_reported_in_one_line() -> None:
    with pytest.raises(Unavailable) as refused:
        stream_samples(REQUEST, Replay(speed=1000.0), as_json=False, server="http://127.0.0.1:9", token=None)
    assert refused.value.code == "service-unreachable"


def test_blocks_come_when_their_last_sample_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    now, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    monkeypatch.setattr("stridelab.cli.stream.time.perf_counter", lambda: now[0])
    monkeypatch.setattr("stridelab.cli.stream.time.sleep", sleep)
    samples = walk_samples(0.1, start_s=3.0)
    blocks = [samples[:10], samples[10:]]
    assert list(pace_blocks(blocks, 0.5)) == blocks
    assert np.cumsum(slept) == pytest.approx([0.045 / 0.5, 0.095 / 0.5])


@pytest.mark.parametrize("options", [{"speed": 0.0}, {"speed": -1.0}, {"speed": float("inf")}, {"block": 0}])
def test_senseless_options_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(InvalidInput) as refused:
        Replay(**options)  # type: ignore[arg-type]
    assert refused.value.code == "option-invalid"


def test_the_quantile_of_the_answers_is_never_beyond_the_longest_answer() -> None:
    nowhere = (0.0, 0.0, 0.0)
    last = StreamEstimate(time_s=0.0, com_m=nowhere, velocity_m_s=nowhere, sd_m=nowhere)
    for took_s in ([0.2], [0.1, 0.2], [0.01, 0.02, 0.2]):
        figures = ReplayResult("complementary", [last], took_s, 1.0).to_json()
        assert figures["answer_median_ms"] <= figures["answer_95_percent_ms"] <= figures["answer_max_ms"]


def test_markers_are_replayed(service: Served, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "balance.csv"
    stream_frames(REQUEST, Replay(speed=4.0, csv=path), as_json=True, server=service.base_url, token=None)
    figures = json.loads(capsys.readouterr().out)
    assert figures["marker_set"] == "isb-head"
    assert figures["without_estimate"] == 0
    assert 0 < figures["without_force"] < figures["samples"], "two plates of a walkway measure a part of the walk"
    assert figures["last"]["margin_m"] is not None
    with path.open(encoding="utf-8", newline="") as file:
        header, *rows = list(csv.reader(file))
    assert tuple(header) == FRAME_COLUMNS
    assert len(rows) == figures["samples"]
    estimates = np.array([row[:11] for row in rows], dtype=float)
    _, samples = prepare_samples(
        EstimateRequest(REQUEST.walk, estimation=Estimation(segment_table="dumas2007")), Replay()
    )
    geometry = np.array([sample.geometry_m for sample in samples])
    assert np.abs(estimates[100:, 1:4] - geometry[100:]).max() < 0.015


def test_the_summary_of_a_live_walk_is_a_table(service: Served, capsys: pytest.CaptureFixture[str]) -> None:
    stream_frames(REQUEST, Replay(speed=1000.0), as_json=False, server=service.base_url, token=None)
    output = capsys.readouterr().out
    for name in ("marker set", "played", "answered", "without estimate", "without force", "last margin", "sideways"):
        assert name in output


@pytest.mark.parametrize(
    "replay", [Replay(method="smoother"), Replay(ahead="1,0"), Replay(block=10), Replay(packed=True)]
)
def test_an_option_that_markers_do_not_use_is_refused(replay: Replay) -> None:
    with pytest.raises(InvalidInput) as refused:
        stream_frames(REQUEST, replay, as_json=False, server="http://127.0.0.1:9", token=None)
    assert refused.value.code == "option-invalid"
