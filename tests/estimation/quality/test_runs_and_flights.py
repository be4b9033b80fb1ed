"""Checks of runs and flights: bodies that bounce or fall by a formula."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import GRAVITY_M_S2
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.quality import Quality, Recorded, assess_quality
from stridelab.estimation.quality.assessment import evaluate_checks
from stridelab.estimation.quality.measures import Measures, acceleration_difference
from stridelab.recordings.recording import Recording, Remark, Subject, Window, WrenchTrack

MASS_KG = 70.0
RUN_HZ, RUN_S = 200.0, 4.0


@dataclass(frozen=True)
class Run:
    """A body that bounces 2.8 times a second, 35 % of it in flight, while it is braked and driven forwards."""

    geometric: GeometricCom
    wrench: WrenchTrack


def run(*, tissue_m: float = 0.0, fore_aft: float = 1.0) -> Run:
    """``tissue_m`` of sway of the markers with the bounces; ``fore_aft`` multiplies that channel of the plates."""
    t = np.arange(round(RUN_S * RUN_HZ)) / RUN_HZ
    period_s, contact_s = 1.0 / 2.8, 0.65 / 2.8
    phase = np.mod(t, period_s) / contact_s
    push = np.where(phase < 1.0, np.pi / 2 * np.sin(np.pi * phase) * period_s / contact_s, 0.0)
    drive = np.where(phase < 1.0, -0.35 * np.sin(2 * np.pi * phase), 0.0)
    acceleration = GRAVITY_M_S2 * np.column_stack([drive, 0.0 * t, push - push.mean()])
    com = np.cumsum(np.cumsum(acceleration, axis=0), axis=0) / RUN_HZ**2 + [0.0, 0.0, 1.0]
    com[:, 0] += 3.0 * t
    com[:, 2] += tissue_m * np.sin(2 * np.pi * 2.8 * t)
    force = MASS_KG * (acceleration * [fore_aft, 1.0, 1.0] + [0.0, 0.0, GRAVITY_M_S2])
    geometric = GeometricCom(t, com, "formula", {}, {}, (0.01, 0.01, 0.02))
    window = Window(0.0, float(t[-1]))
    return Run(geometric, WrenchTrack(t, force, 0.0 * force, np.ones(len(t), dtype=bool), (window,)))


def contradicts_in(made: Run) -> bool:
    difference = acceleration_difference(made.geometric, made.wrench, MASS_KG)
    assert difference is not None
    measures = Measures(
        acceleration_difference=difference.share,
        axis=difference.axis,
        force_share=difference.force_share,
        unmarked_share=difference.unmarked_share,
    )
    (check,) = evaluate_checks(measures, MASS_KG, made.geometric.sd_m).checks
    return check.contradicts


def test_soft_tissue_does_not_contradict_the_large_forces_of_a_run() -> None:
    """8 mm at the step frequency of a run are 18 % of the weight: as much as the vertical force of a walk varies."""
    shaken = run(tissue_m=0.008)
    difference = acceleration_difference(shaken.geometric, shaken.wrench, MASS_KG)
    assert difference is not None
    assert difference.axis == "vertically"
    assert 0.15 < difference.share < 0.2
    assert difference.force_share > 0.8
    assert not contradicts_in(shaken)


def with_swaying_pelvis(made: Run, sway_m: float, *, marked: bool) -> Run:
    """A pelvis that sways along the run under a steady trunk, half of the body, which the geometry puts above it."""
    t = made.geometric.time_s
    sway = sway_m * np.sin(2 * np.pi * 2.8 * t)[:, None] * [1.0, 0.0, 0.0]
    remarks = () if marked else (Remark("trunk-missing", "No trunk is marked."),)
    com, lumbar = made.geometric.com_m + 0.49 * sway, made.geometric.com_m + sway
    return replace(
        made, geometric=replace(made.geometric, com_m=com, joint_centres_m={"lumbar": lumbar}, remarks=remarks)
    )


def test_a_pelvis_that_sways_under_an_unmarked_trunk_contradicts_no_run_and_a_wrong_sign_still_does() -> None:
    """16 mm at the step frequency are 17 % of the weight along, if the trunk is thought to sway with it."""
    made, reversed_ = run(), run(fore_aft=-1.0)
    assert contradicts_in(with_swaying_pelvis(made, 0.016, marked=True))
    assert not contradicts_in(with_swaying_pelvis(made, 0.016, marked=False))
    assert contradicts_in(with_swaying_pelvis(reversed_, 0.016, marked=False))


def test_a_fore_aft_channel_of_the_wrong_sign_contradicts_a_run() -> None:
    assert not contradicts_in(run(fore_aft=1.0))
    assert contradicts_in(run(fore_aft=-1.0))


def fall(share: float, *, measured: bool = True) -> Quality:
    """Checks of a result that falls with ``share`` times the acceleration of gravity in a flight of 0.2 s."""
    t = np.arange(100) / 100.0
    flight = (t >= 0.4) & (t < 0.6)
    height = 1.0 - 0.5 * share * GRAVITY_M_S2 * np.clip(t - 0.4, 0.0, 0.2) ** 2
    com = np.column_stack([0.0 * t, 0.0 * t, height])
    force = np.column_stack([0.0 * t, 0.0 * t, np.where(flight, 0.0, 700.0)])
    window = Window(0.0, 0.99)
    estimate = ComEstimate("formula", t, com, 0.0 * com, 0.0 * com, 0.0 * com, window, ())
    wrench = WrenchTrack(t, force, 0.0 * force, np.full(100, measured), (window,))
    geometric = GeometricCom(t, com, "formula", {}, {}, (0.01, 0.01, 0.02))
    recording = Recording({"a": com}, 100.0, 100.0, (), Subject(), (), "+z", None)
    return assess_quality(Recorded(recording, {}, geometric, wrench, MASS_KG), estimate)


@pytest.mark.parametrize(
    ("share", "passed", "contradicts"), [(1.0, True, False), (0.8, False, False), (0.4, False, True)]
)
def test_a_body_in_flight_falls_with_gravity(share: float, passed: bool, contradicts: bool) -> None:
    (check,) = [check for check in fall(share).checks if check.name == "flight_acceleration"]
    assert check.value == pytest.approx(1.0 - share, abs=0.01)
    assert (check.passed, check.contradicts) == (passed, contradicts)


def test_what_is_not_measured_is_no_flight() -> None:
    assert "flight_acceleration" in fall(0.4, measured=False).not_checked
