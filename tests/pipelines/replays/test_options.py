"""Options of a replay: what does not fit is refused by name, what fits reaches the simulation."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.contacts.terrain import Terrain
from stridelab.errors import InvalidInput
from stridelab.pipelines.replays.options import disturbances_of, link_names, observer_of, require_pushes
from stridelab.pipelines.replays.replay_estimation import FilteredCom
from stridelab.robots.loader import load_robot, robot_names
from stridelab.schemas.plans import ReplayOptions
from stridelab.wholebody.replay.mujoco_model import build_simulation
from support.robots.plans import run, short_walk


def pushed(time_s: float, link: str | None = None) -> ReplayOptions:
    return ReplayOptions.model_validate({"pushes": [{"time_s": time_s, "impulse_ns": [0, 5, 0], "link": link}]})


def test_a_push_after_the_end_or_on_an_unknown_link_is_refused_by_name() -> None:
    require_pushes(pushed(3.4, "torso_2_link"), "talos", 3.4)
    require_pushes(True, "talos", 3.4)
    with pytest.raises(InvalidInput) as refusal:
        require_pushes(pushed(3.5, "nose"), "talos", 3.4)
    assert refusal.value.code == "replay-invalid"
    late, unknown = refusal.value.faults
    assert (late.where, unknown.where) == ("replay.pushes.0.time_s", "replay.pushes.0.link")
    assert "which lasts 3.4 s" in late.message
    assert "arm_left_4_link" in unknown.message, "the links are listed"


@pytest.mark.parametrize("name", robot_names())
def test_every_listed_link_can_be_pushed(name: str) -> None:
    built = build_simulation(load_robot(name), Terrain(()), 0.3, ("left_foot", "right_foot"))
    assert sorted(built.body_of(link) for link in link_names(name)) == list(range(1, built.model.nbody))
    with pytest.raises(InvalidInput, match=link_names(name)[-1]):
        built.body_of("nose")


def test_the_options_reach_the_simulation() -> None:
    options = {"delay_s": 0.002, "payload_kg": 3.0, "friction": 0.2, "sensors": "estimated"}
    made = disturbances_of(ReplayOptions.model_validate(pushed(1.0, "base_link").model_dump() | options))
    assert (made.delay_s, made.joint_delay_s, made.trunk_mass_kg, made.friction) == (0.002, 0.002, 3.0, 0.2)
    (push,) = made.pushes
    assert (push.time_s, push.impulse_ns, push.link) == (1.0, (0.0, 5.0, 0.0), "base_link")
    assert made.sensor_noise is not None
    assert isinstance(observer_of(ReplayOptions(sensors="estimated"), load_robot("talos")), FilteredCom)


def test_a_plan_is_replayed_with_its_options(tmp_path: Path) -> None:
    """A push to the left moves the centre of mass to the left, and the summary repeats the options."""
    options = ReplayOptions.model_validate(
        {"pushes": [{"time_s": 0.3, "impulse_ns": [0.0, 12.0, 0.0]}], "sensors": "estimated"}
    )
    (tmp_path / "calm").mkdir()
    (tmp_path / "pushed").mkdir()
    calm = run(tmp_path / "calm", short_walk(), replay=True)
    made = run(tmp_path / "pushed", short_walk(), replay=options)
    assert calm.summary.replay is not None
    assert made.summary.replay is not None
    assert (calm.summary.replay.options, made.summary.replay.options) == (None, options)
    assert made.summary.replay.fall_time_s is None
    assert made.summary.replay.com_error_max_m > 2.0 * calm.summary.replay.com_error_max_m
    left_m = made.columns("replay.parquet", "com_y_m")[:125, 0] - calm.columns("replay.parquet", "com_y_m")[:125, 0]
    assert np.argmax(left_m > 0.005) * 0.004 == pytest.approx(0.4, abs=0.1)
    assert left_m.max() > 0.005


def test_a_fall_after_a_push_says_whether_it_is_proved_lost(tmp_path: Path) -> None:
    options = ReplayOptions.model_validate({"pushes": [{"time_s": 1.0, "impulse_ns": [0.0, 120.0, 0.0]}]})
    replay = run(tmp_path, short_walk(), replay=options).summary.replay
    assert replay is not None
    assert replay.fall_time_s is not None
    assert replay.proved_lost is False, "the ground is wide enough for a step"
