"""Walks of which a part cannot be measured: each reason is named, and nothing that is not measured is zero."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import stridelab as sl
from stridelab.errors import NotEstimable
from stridelab.recordings.files.c3d_writer import write_c3d
from stridelab.recordings.recording import Plate, Recording
from stridelab.reproduction.studies.estimator_study import clean_motion
from stridelab.schemas.measures import GaitMeasuresSummary
from stridelab.simulation.noise import NOISE_FREE
from stridelab.simulation.robot_recording import record_robot
from support.command_line import SAMPLE

FOOT_LABELS = ("FCC", "FM1", "FM2", "FM5")


@pytest.fixture(scope="module")
def walk() -> Recording:
    return sl.read(SAMPLE / "recording.c3d").recording


def measures(folder: Path, recording: Recording) -> GaitMeasuresSummary:
    write_c3d(folder / "walk.c3d", recording)
    return sl.gait_measures(folder / "walk.c3d").summary


def refused(folder: Path, recording: Recording) -> str:
    """Code, message and faults of the refusal."""
    with pytest.raises(NotEstimable) as caught:
        measures(folder, recording)
    return " ".join([caught.value.code, caught.value.message, *(fault.message for fault in caught.value.faults)])


def with_plates(walk: Recording, change: Callable[[Plate], Plate]) -> Recording:
    return replace(walk, plates=tuple(change(plate) for plate in walk.plates))


def scaled(plate: Plate, share: float) -> Plate:
    return replace(plate, force_n=share * plate.force_n, moment_nm=share * plate.moment_nm)


def reasons(summary: GaitMeasuresSummary) -> dict[str, str]:
    assert not [one.name for one in summary.measures if one.mean == 0.0]
    assert not {one.name for one in summary.measures} & {one.name for one in summary.not_measured}
    return {one.name: f"{one.code}: {one.message}" for one in summary.not_measured}


def test_one_foot_on_a_plate_has_no_work_of_the_other_leg(tmp_path: Path, walk: Recording) -> None:
    """The second of two plates is never loaded: the work of the foot on the first is known, that of the other not."""
    last = walk.plates[-1].index
    summary = measures(tmp_path, with_plates(walk, lambda p: scaled(p, 0.0) if p.index == last else p))
    missing = reasons(summary)
    both = {"limb_work_left_positive", "limb_work_right_positive"}
    (other,) = both & set(missing)
    assert "no-separate-forces" in missing[other]
    assert both - {other} <= {one.name for one in summary.measures}
    assert summary.method == "geometry"
    assert next(one for one in summary.measures if one.name == "walking_speed").mean > 0.5


def without_foot(walk: Recording, *sides: str) -> Recording:
    hidden = {f"{side}_{name}" for side in sides for name in FOOT_LABELS}
    return replace(walk, markers_m={label: track for label, track in walk.markers_m.items() if label not in hidden})


def test_a_side_without_markers_leaves_the_strides_and_margins_of_the_other(tmp_path: Path, walk: Recording) -> None:
    whole = measures(tmp_path, replace(walk, plates=()))
    summary = measures(tmp_path, without_foot(replace(walk, plates=()), "L"))
    missing = reasons(summary)
    assert summary.sides == {"left": 0, "right": 3}
    assert {one.side for one in summary.measures} == {None, "right"}
    assert any(one.code == "one-foot-marked" and "Only the right foot" in one.message for one in summary.warnings)
    for name in ("step_length", "step_width", "step_time", "margin_of_stability_ml_min", "limb_work_right_positive"):
        assert missing[name].startswith("one-foot-marked: Only the right foot is marked")
    values = {one.name: one.mean for one in summary.measures if one.side == "right"}
    both = {one.name: one.mean for one in whole.measures if one.side == "right"}
    assert values["stride_time"] == pytest.approx(both["stride_time"], abs=0.005)
    assert values["stride_length"] == pytest.approx(both["stride_length"], abs=0.01)
    assert values["walking_speed"] == pytest.approx(both["walking_speed"], abs=0.02)
    for name in ("margin_of_stability_ml_contact", "margin_of_stability_ap_contact"):
        assert values[name] == pytest.approx(both[name], abs=0.006)


def test_without_markers_on_both_feet_a_walk_is_refused(tmp_path: Path, walk: Recording) -> None:
    message = refused(tmp_path, without_foot(walk, "L", "R"))
    assert "feet-not-marked" in message
    assert "both feet" in message


def test_a_marked_cane_is_remarked_on_and_support_that_no_plate_sees_is_named(tmp_path: Path, walk: Recording) -> None:
    cane = {"person:LCane1": walk.markers_m["L_FCC"] + [0.0, 0.3, 0.0]}
    summary = measures(tmp_path, replace(walk, plates=(), markers_m={**walk.markers_m, **cane}))
    (remark,) = (one for one in summary.warnings if one.code == "walking-aid-marked")
    assert "LCane1" in remark.message
    assert reasons(summary)["support_beside_feet"].startswith("no-measured-force: Whether a cane, a rail")
    with_force = measures(tmp_path, walk)
    assert "support_beside_feet" not in reasons(with_force)
    assert not [one for one in with_force.warnings if one.code == "walking-aid-marked"]


def test_weight_on_a_walking_aid_leaves_what_the_markers_say(tmp_path: Path, walk: Recording) -> None:
    """A fifth of the weight is on a cane that no plate measures."""
    summary = measures(tmp_path, with_plates(walk, lambda plate: scaled(plate, 0.8)))
    missing = reasons(summary)
    assert summary.method == "geometry"
    (remark,) = (one for one in summary.warnings if one.code == "weight-beside-plates")
    assert re.search(r"carry (79|80|81) % of the body weight", remark.message)
    assert missing["limb_work_left_positive"].startswith("weight-beside-plates")
    assert missing["limb_work_right_positive"].startswith("weight-beside-plates")
    margin = next(one for one in summary.measures if one.name == "margin_of_stability_ml_min")
    assert margin.error_sd is not None
    assert margin.ci95 is not None


def test_too_much_weight_on_the_plates_is_a_contradiction(tmp_path: Path, walk: Recording) -> None:
    message = refused(tmp_path, with_plates(walk, lambda plate: scaled(plate, 1.25)))
    assert "contradict" in message


@pytest.mark.parametrize("plates", [True, False])
def test_a_run_is_not_measured_as_a_walk(tmp_path: Path, plates: bool) -> None:
    running = record_robot(clean_motion("running"), NOISE_FREE, 0).recording
    message = refused(tmp_path, running if plates else replace(running, plates=()))
    assert "it is running" in message


def test_three_steps_give_their_values_and_name_what_needs_more(tmp_path: Path, walk: Recording) -> None:
    frames, samples = 200, round(2.0 * walk.force_rate_hz)
    short = replace(walk, markers_m={label: track[:frames] for label, track in walk.markers_m.items()})
    summary = measures(
        tmp_path,
        with_plates(short, lambda p: replace(p, force_n=p.force_n[:samples], moment_nm=p.moment_nm[:samples])),
    )
    missing = reasons(summary)
    assert summary.steps == 3
    assert missing["foot_placement_residual"] == (
        "too-few-steps: 3 steps; the regression needs at least 12 within the estimates."
    )
    assert "needs at least 150" in missing["local_dynamic_stability"]
    assert next(one for one in summary.measures if one.name == "step_length" and one.side is None).n == 3
