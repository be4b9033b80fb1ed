"""Progress messages in words: no name of a stage and no term of the solver is left."""

from typing import get_args

import pytest

from stridelab.pipelines.commissioning import commission_robot
from stridelab.pipelines.replays import push_basin
from stridelab.schemas.plans import PLAN_STAGES
from stridelab.schemas.robots import Measure
from stridelab.service.jobs.progress_words import STAGE_WORDS, progress_of, progress_words


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            "centroidal: iteration 12, cost 4.213, infeasibility 1.2e-03",
            "planning the centre of mass: improved 12 times so far",
        ),
        ("centroidal: solving for 5.0 s", "planning the centre of mass: a motion of 5.0 s"),
        ("check: looking at the scenario", "checking the contacts"),
        ("whole body: 37 %, 1.9 of 5.0 s", "moving the whole body along the plan: 37 %, at 1.9 of 5.0 s of the motion"),
        ("replay: replay: 1.9 of 5.0 s", "simulating the motion in physics: at 1.9 of 5.0 s of the motion"),
        (
            "pace 0.8: centroidal: iteration 3, cost 1, infeasibility 1e-3",
            "at 0.8 times the pace: planning the centre of mass: improved 3 times so far",
        ),
        ("looking at the scenario", "looking at the scenario"),
        ("fusing markers and force", "fusing markers and force"),
        ("walk-3.c3d", "walk-3.c3d"),
        ("", ""),
    ],
)
def test_a_message_is_shown_in_words(message: str, words: str) -> None:
    assert progress_words(message) == words


def test_every_stage_of_a_run_has_words() -> None:
    stages = {*PLAN_STAGES, push_basin.PUSHES, commission_robot.WALK, commission_robot.SEARCH, *get_args(Measure)}
    assert stages == set(STAGE_WORDS)


def test_the_message_for_machines_stays_beside_its_words() -> None:
    progress = progress_of(0.4, "export: writing the plan")
    assert progress.message == "export: writing the plan"
    assert progress.text == "writing the files"
