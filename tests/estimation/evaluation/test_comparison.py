"""All estimators on the same data: what is reported of each, what of those that cannot, and held-back force."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from stridelab.body.geometric_com import GeometricCom
from stridelab.errors import NotEstimable
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.comparison import Comparison, ComparisonData, KnownMotion, compare
from stridelab.estimation.evaluation.holdout_force import withheld_residual_n
from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.recording import Window, WrenchTrack
from support.recordings.analytic_motions import walk

T = np.arange(500) / 100.0
BIAS = np.array([0.01, -0.008, 0.02])


@dataclass(frozen=True, kw_only=True)
class Refuses:
    name: ClassVar[str] = "refuses"

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        raise NotEstimable("no-window", "Not this one.")


@dataclass(frozen=True, kw_only=True)
class CopiesTheForce:
    """Integrates whatever force it is shown, held-back stand-ins included: perfect in hindsight, blind ahead."""

    name: ClassVar[str] = "copies"
    noise_m: float = 0.004

    def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
        given = ComplementaryFilter().estimate(geometric, wrench, mass_kg)
        wiggle = self.noise_m * np.sin(2 * np.pi * 6.0 * given.time_s)[:, None]
        return replace(given, com_m=given.com_m + wiggle)


def data(with_truth: bool = True, seed: int = 0) -> ComparisonData:
    rng = np.random.default_rng(seed)
    motion = walk()
    geometric = motion.geometric(T, BIAS, 0.001 * rng.standard_normal((len(T), 3)))
    wrench = motion.wrench_track(T, Window(0.5, 4.5))
    noise = 5.0 * rng.standard_normal((len(T), 3))
    noisy = replace(wrench, force_n=wrench.force_n + noise, moment_nm=wrench.moment_nm + np.cross([2.0, 0, 0], noise))
    truth = KnownMotion(motion.com.at(T), motion.force(T)) if with_truth else None
    return ComparisonData(geometric, noisy, motion.mass_kg, truth)


ESTIMATORS = {"geometry": GeometryOnly(), "filter": ComplementaryFilter(), "refuses": Refuses()}


@pytest.fixture(scope="module")
def known() -> Comparison:
    return compare(ESTIMATORS, data())


@pytest.fixture(scope="module")
def unknown() -> Comparison:
    return compare(ESTIMATORS, data(with_truth=False))


def test_errors_are_those_put_in(known: Comparison) -> None:
    alone, fused = known.assessments["geometry"], known.assessments["filter"]
    assert alone.truth is not None
    assert fused.truth is not None
    assert alone.truth.mean_m == pytest.approx(BIAS, abs=2e-4)
    assert fused.truth.horizontal_m < 0.5 * alone.truth.horizontal_m
    assert fused.truth.vertical_m == pytest.approx(alone.truth.vertical_m, rel=0.05)
    assert alone.offset_m == pytest.approx(np.zeros(3), abs=1e-12)
    assert fused.offset_m[:2] == pytest.approx(-BIAS[:2], abs=4e-3)


def test_a_refusal_is_listed_and_all_refusals_are_raised(known: Comparison) -> None:
    assert set(known.assessments) == {"geometry", "filter"}
    assert known.failures["refuses"].code == "no-window"
    with pytest.raises(NotEstimable, match="Not this one"):
        compare({"refuses": Refuses()}, data())


def test_spectra_of_the_inputs_are_those_of_figure_2_6(known: Comparison) -> None:
    g, a, p = (known.inputs[name] for name in ("geometry", "force", "axis"))
    assert g.band_rms(0.0, 1.0)[:2] == pytest.approx(np.abs(BIAS[:2]), rel=0.1)
    assert a.band_rms(0.0, 51.0) == pytest.approx(5.0 / 70.0, rel=0.2)
    # L' about the lateral axis: 2.2 Nms at 1.8 Hz over the weight, an error of p along the walk.
    line = 2.2 * 2 * np.pi * 1.8 / (70 * 9.81) / np.sqrt(2)
    assert p.band_rms(1.2, 2.4)[0] == pytest.approx(line, rel=0.1)
    assert p.band_rms(1.2, 2.4)[0] > 5 * p.band_rms(0.0, 0.5)[0]


def test_without_a_truth_the_inputs_are_held_against_each_other(unknown: Comparison) -> None:
    assert set(unknown.inputs) == {"force", "axis"}
    assert all(assessment.truth is None for assessment in unknown.assessments.values())
    offset = unknown.inputs["axis"].band_rms(0.0, 0.6)
    assert offset[1] == pytest.approx(abs(BIAS[1]), rel=0.15)
    # Along the walk the axis adds what L' leaves of itself when the force swings with it: millimetres, behind.
    assert abs(BIAS[0]) + 0.002 < offset[0] < abs(BIAS[0]) + 0.005
    assert unknown.assessments["geometry"].spectrum.band_rms(0.0, 51.0) == pytest.approx(np.zeros(3), abs=1e-12)


def test_held_back_force_tells_noise_from_knowledge() -> None:
    """No estimator predicts much better than the geometry; one that adds wiggles predicts worse."""
    given = data()
    alone = withheld_residual_n(GeometryOnly(), given.geometric, given.wrench, given.mass_kg)
    fused = withheld_residual_n(ComplementaryFilter(), given.geometric, given.wrench, given.mass_kg)
    wiggling = withheld_residual_n(CopiesTheForce(), given.geometric, given.wrench, given.mass_kg)
    assert (fused < alone).all()
    # 4 mm at 6 Hz are 70 kg times 5.7 m/s^2, less what the 8 Hz band takes.
    assert (wiggling > 3 * alone).all()


def test_the_withheld_force_is_not_seen() -> None:
    """An error that sits in every other block shows where that block is withheld."""
    given = data()
    inside = np.flatnonzero(given.wrench.complete)
    odd = inside[np.arange(len(inside)) // 15 % 2 == 1]
    spoilt = given.wrench.force_n.copy()
    spoilt[odd] += [0.0, 0.0, 300.0]
    wrong = replace(given.wrench, force_n=spoilt)
    residual_n = withheld_residual_n(ComplementaryFilter(), given.geometric, wrong, given.mass_kg)
    assert residual_n[2] > 150.0


@pytest.mark.parametrize(
    "estimator",
    [ComplementaryFilter(), KalmanFilter.tuned(), RtsSmoother.tuned(), Smoother()],
    ids=lambda e: e.name,
)
def test_a_withheld_force_changes_nothing_and_the_rest_does(estimator: ComEstimator) -> None:
    """However wrong the plates are where they are withheld, the estimate of that pass is the same to the last bit."""
    given = data()
    shown: list[WrenchTrack] = []

    @dataclass(frozen=True, kw_only=True)
    class Looks:
        name: ClassVar[str] = estimator.name

        def estimate(self, geometric: GeometricCom, wrench: WrenchTrack, mass_kg: float) -> ComEstimate:
            shown.append(wrench)
            return GeometryOnly().estimate(geometric, wrench, mass_kg)

    inside = np.flatnonzero(given.wrench.complete)
    odd = inside[np.arange(len(inside)) // 15 % 2 == 1]
    spoilt = given.wrench.force_n.copy()
    spoilt[odd] += [50.0, -30.0, 300.0]
    for wrench in (given.wrench, replace(given.wrench, force_n=spoilt)):
        withheld_residual_n(Looks(), given.geometric, wrench, given.mass_kg)
    (first, second, first_spoilt, second_spoilt) = (
        estimator.estimate(given.geometric, wrench, given.mass_kg).com_m for wrench in shown
    )
    assert (first == first_spoilt).all()
    assert np.abs(second - second_spoilt).max() > 0.001
    assert shown[0].withheld is not None
    assert shown[1].withheld is not None
    assert (shown[0].withheld ^ shown[1].withheld)[inside].all()
    whole = estimator.estimate(given.geometric, given.wrench, given.mass_kg).com_m
    assert np.abs(first - whole).max() > 1e-5, "half of the force is missed"


@pytest.mark.parametrize("estimator", [KalmanFilter.tuned(), RtsSmoother.tuned(), Smoother()], ids=lambda e: e.name)
def test_the_stand_in_is_not_read_where_the_force_is_really_done_without(estimator: ComEstimator) -> None:
    given = data()
    inside = np.flatnonzero(given.wrench.complete)
    withheld = np.zeros(len(T), dtype=np.bool_)
    withheld[inside[np.arange(len(inside)) // 15 % 2 == 1]] = True
    force = given.wrench.force_n.copy()
    force[withheld] += [30.0, 30.0, 0.0]

    def moved(mask: np.ndarray | None) -> float:
        pair = [replace(given.wrench, force_n=f, withheld=mask) for f in (given.wrench.force_n, force)]
        one, other = (estimator.estimate(given.geometric, wrench, given.mass_kg).com_m for wrench in pair)
        return float(np.abs(one - other).max())

    assert moved(withheld) < 0.03 * moved(None)
