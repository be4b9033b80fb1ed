"""Recordings that are no straight walk are refused before anything is planned; stairs are not."""

from pathlib import Path

import pytest

import stridelab as sl
from stridelab.errors import NotEstimable, NotFound, StridelabError
from stridelab.pipelines.imitation.recorded_walk import RecordedWalk, rises_of
from support.command_line import SAMPLE


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("biomechzoo-sample-study/HC032A/Turn_HC032A18.c3d", "turning"),
        ("biomechzoo-sample-study/HC040A/Straight_HC040A14.c3d", "too-few-footholds"),
    ],
)
def test_no_level_walk_is_refused_with_its_code(gait: Path, file: str, code: str) -> None:
    with pytest.raises(NotEstimable) as caught:
        sl.imitate(gait / file, robot="talos")
    assert caught.value.code == code


def test_recorded_stairs_are_those_of_the_plates(gait: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The plates of this recording lie at 0, 195, 389 and 584 mm; a platform is above them, the floor below."""
    asked: list[RecordedWalk] = []

    def find_pace(recorded: RecordedWalk, *_: object, **_options: object) -> None:
        asked.append(recorded)
        raise NotEstimable("imitation-not-certified", "Stopped here.")

    monkeypatch.setattr("stridelab.pipelines.imitation.imitate.find_pace", find_pace)
    with pytest.raises(NotEstimable, match="Stopped here"):
        sl.imitate(gait / "pycgm-stairs/Movement_trial.c3d", robot="talos")
    (walk,) = asked
    assert [hold.side for hold in walk.footholds] == ["left", "right"] * 3
    assert rises_of(walk.footholds)[1:4] == pytest.approx([-0.195, -0.194, -0.195], abs=0.004)
    assert walk.footholds[-1].height_m == 0.0
    assert 0.45 * 1.679 < walk.hip_height_m < 0.53 * 1.679, "of a person of 1.679 m, above the tread"


def test_an_unknown_robot_is_refused_before_the_recording_is_measured() -> None:
    with pytest.raises(NotFound) as caught:
        sl.imitate(SAMPLE / "recording.c3d", robot="nobody")
    assert caught.value.code == "robot-not-found"


def test_a_pace_out_of_range_is_named() -> None:
    with pytest.raises(StridelabError) as caught:
        sl.imitate(SAMPLE / "recording.c3d", robot="talos", pace=-1.0)
    assert any("pace" in fault.where for fault in caught.value.faults)
