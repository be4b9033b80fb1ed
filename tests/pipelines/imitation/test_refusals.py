"""Recordings that are no level walk are refused before anything is planned."""

from pathlib import Path

import pytest

import stridelab as sl
from stridelab.errors import NotEstimable, NotFound, StridelabError
from support.command_line import SAMPLE


@pytest.mark.parametrize(
    ("file", "code"),
    [
        ("pycgm-stairs/Movement_trial.c3d", "stairs"),
        ("biomechzoo-sample-study/HC032A/Turn_HC032A18.c3d", "turning"),
        ("biomechzoo-sample-study/HC040A/Straight_HC040A14.c3d", "too-few-footholds"),
    ],
)
def test_no_level_walk_is_refused_with_its_code(gait: Path, file: str, code: str) -> None:
    with pytest.raises(NotEstimable) as caught:
        sl.imitate(gait / file, robot="talos")
    assert caught.value.code == code


def test_an_unknown_robot_is_refused_before_the_recording_is_measured() -> None:
    with pytest.raises(NotFound) as caught:
        sl.imitate(SAMPLE / "recording.c3d", robot="nobody")
    assert caught.value.code == "robot-not-found"


def test_a_pace_out_of_range_is_named() -> None:
    with pytest.raises(StridelabError) as caught:
        sl.imitate(SAMPLE / "recording.c3d", robot="talos", pace=-1.0)
    assert any("pace" in fault.where for fault in caught.value.faults)
