"""The study's inputs: noise as stated, reproducible, at the plate; truth exact; excerpts and partial force."""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.dynamics.wrench import Wrench, central_axis
from stridelab.errors import InvalidInput
from stridelab.reproduction.studies.estimator_study import StudyTrial, clean_motion, simulate_trial
from stridelab.simulation.human.body_proportions import SIDES
from stridelab.simulation.noise import PRESETS, NoisePreset, coloured_noise
from stridelab.simulation.robot.gait_plan import GaitName
from stridelab.simulation.robot.walker import RATE_HZ, RobotWalk

GAITS: tuple[GaitName, ...] = ("robot", "human", "running")


def trials(gait: GaitName, noise: NoisePreset | str, seeds: int) -> list[StudyTrial]:
    return [simulate_trial(gait, noise, seed) for seed in range(seeds)]


@pytest.fixture(scope="module")
def thesis() -> list[StudyTrial]:
    return trials("robot", "thesis", 12)


@pytest.mark.parametrize("gait", GAITS)
def test_without_noise_everything_is_true(gait: GaitName) -> None:
    trial = simulate_trial(gait, "none")
    t = trial.truth
    np.testing.assert_allclose(trial.geometric.com_m, t.com_m, atol=1e-12)
    np.testing.assert_array_equal(trial.wrench.force_n, t.force_n)
    np.testing.assert_array_equal(trial.wrench.moment_nm, t.moment_nm)
    np.testing.assert_allclose(t.time_s, np.arange(len(t.time_s)) / RATE_HZ, atol=1e-12)
    assert trial.wrench.complete.all()
    assert sum(s.mass_fraction for s in trial.geometric.segments.values()) == pytest.approx(1.0)


def test_durations_are_those_of_the_study() -> None:
    """Section 2.5: 9.2 s at the robot's cadence; rest, walk, rest."""
    assert len(simulate_trial("robot", "none").truth.time_s) == round(9.2 * RATE_HZ)
    human = simulate_trial("human", "none")
    assert human.step_time_s == pytest.approx(0.55)


def test_configuration_noise_of_the_thesis_moves_the_com_as_in_the_prototype(thesis: list[StudyTrial]) -> None:
    """0.05 pi on every joint: 13.7, 12.6, 5.3 mm; 0.01 rad: 0.9 mm. The base has none of it."""
    result = 1e3 * np.mean([trial.noise_sd_m for trial in thesis], axis=0)
    np.testing.assert_allclose(result, [13.7, 12.6, 5.3], rtol=0.1)
    slight = 1e3 * np.mean([trial.noise_sd_m for trial in trials("human", "marker-like", 4)], axis=0)
    assert slight[0] == pytest.approx(0.9, abs=0.1)


def test_geometry_errs_by_bias_and_noise(thesis: list[StudyTrial]) -> None:
    """20 % of masses and levers: 7 and a few mm horizontally, 11 to 23 mm vertically, hardly varying (2.21)."""
    bias_mm = 1e3 * np.array([trial.bias_m.mean(axis=0) for trial in thesis])
    x, _, z = np.sqrt(np.mean(bias_mm**2, axis=0))
    assert 3.0 < x < 12.0
    assert 11.0 < z < 35.0
    assert np.max([trial.bias_m.std(axis=0) for trial in thesis]) < 2.5e-3
    for trial in thesis[:3]:
        error = trial.geometric.com_m - trial.truth.com_m
        np.testing.assert_allclose((error - trial.bias_m).std(axis=0), trial.noise_sd_m, rtol=1e-9)


def test_the_declared_error_of_the_table_is_the_drawn_one() -> None:
    draws = trials("robot", NoisePreset(mass_model=0.2), 60)
    bias = np.array([trial.bias_m.mean(axis=0) for trial in draws])
    declared = np.array(draws[0].geometric.sd_m)
    share = (np.abs(bias) < 1.96 * declared).mean(axis=0)
    assert np.all(share > 0.85)
    assert np.all(np.sqrt(np.mean(bias**2, axis=0)) > 0.3 * declared)
    twice = simulate_trial("robot", NoisePreset(mass_model=0.4)).geometric.sd_m
    np.testing.assert_allclose(twice, 2.0 * declared, rtol=0.25)


def wrench_errors(trial: StudyTrial) -> tuple[np.ndarray, np.ndarray]:
    """Errors of force, and of moment about the planned centre of pressure of the loaded feet."""
    source = clean_motion(trial.gait)
    inside = (source.motion.time_s > -1e-9) & (source.motion.time_s < source.plan.duration_s - 1e-9)
    plate = np.zeros_like(trial.truth.com_m)
    for side in SIDES:
        plate[:, :2] += (source.load.share[side][:, None] * source.load.cop_m[side])[inside]
    force = trial.wrench.force_n - trial.truth.force_n
    return force, trial.wrench.moment_nm - trial.truth.moment_nm - np.cross(plate, force)


def test_wrench_noise_has_the_stated_level_at_the_plate(thesis: list[StudyTrial]) -> None:
    force, moment = wrench_errors(thesis[0])
    np.testing.assert_allclose(force.std(axis=0), 10.0, rtol=1e-9)
    np.testing.assert_allclose(moment.std(axis=0), 10.0, rtol=1e-9)
    spectrum = np.abs(np.fft.rfft(force[:, 0])) ** 2
    slow = np.fft.rfftfreq(len(force), 1.0 / RATE_HZ) < 2.0
    assert spectrum[slow].sum() < 0.01 * spectrum.sum(), "high frequencies only"
    white, _ = wrench_errors(simulate_trial("robot", "white"))
    spectrum = np.abs(np.fft.rfft(white[:, 0])) ** 2
    assert spectrum[slow].sum() == pytest.approx(slow.mean() * spectrum.sum(), rel=0.5)


def test_plate_bias_is_constant_at_the_plate_and_has_the_stated_size() -> None:
    noise = NoisePreset(plate_bias_n=5.0, plate_bias_nm=3.0)
    errors = [wrench_errors(trial) for trial in trials("human", noise, 60)]
    for force, moment in errors[:5]:
        np.testing.assert_allclose(np.ptp(force, axis=0), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.ptp(moment, axis=0), 0.0, atol=1e-9)
    assert np.std([force[0] for force, _ in errors]) == pytest.approx(5.0, rel=0.2)
    assert np.std([moment[0] for _, moment in errors]) == pytest.approx(3.0, rel=0.2)


def test_plate_bias_moves_the_axis_by_millimetres_however_far_the_walk_has_come() -> None:
    """Given at the laboratory's origin, the same bias would tear the axis away as the robot walks on."""
    trial = simulate_trial("human", NoisePreset(plate_bias_n=5.0, plate_bias_nm=3.0), 1)
    com = trial.truth.com_m
    measured, exact = (
        central_axis(Wrench(force, moment)).project(com)
        for force, moment in (
            (trial.wrench.force_n, trial.wrench.moment_nm),
            (trial.truth.force_n, trial.truth.moment_nm),
        )
    )
    shift = np.linalg.norm(measured - exact, axis=1)
    assert com[-1, 0] > 4.0
    assert shift[-200:].max() < 0.025
    assert shift[-200:].max() < 3.0 * shift[:200].max() + 2e-3


def test_latency_makes_the_force_late() -> None:
    late, on_time = (simulate_trial("human", NoisePreset(latency_s=latency)) for latency in (0.02, 0.0))
    np.testing.assert_allclose(late.wrench.force_n[4:], on_time.wrench.force_n[:-4], atol=1e-6)
    between = simulate_trial("human", NoisePreset(latency_s=0.018))
    shifted = [
        np.sum((between.wrench.force_n[k : k - 20] - on_time.wrench.force_n[: len(late.truth.time_s) - 20]) ** 2)
        for k in range(10)
    ]
    assert int(np.argmin(shifted)) == 4


def test_same_seed_same_trial_and_streams_are_apart(thesis: list[StudyTrial]) -> None:
    again, other = simulate_trial("robot", "thesis", 0), thesis[1]
    np.testing.assert_array_equal(again.geometric.com_m, thesis[0].geometric.com_m)
    np.testing.assert_array_equal(again.wrench.moment_nm, thesis[0].wrench.moment_nm)
    assert np.abs(other.wrench.force_n - again.wrench.force_n).max() > 1.0
    assert np.abs(other.geometric.com_m - again.geometric.com_m).max() > 1e-3
    np.testing.assert_array_equal(other.truth.com_m, again.truth.com_m)
    quiet = simulate_trial("robot", replace(PRESETS["thesis"], configuration_rad=0.0), 0)
    np.testing.assert_array_equal(quiet.wrench.force_n, again.wrench.force_n)
    np.testing.assert_allclose(quiet.bias_m, again.bias_m, atol=1e-12)


def test_walk_seed_varies_the_walk(robot_walk: RobotWalk) -> None:
    other = simulate_trial("robot", "none", walk_seed=1)
    here = simulate_trial("robot", "none")
    assert np.abs(other.truth.force_n - here.truth.force_n).max() > 20.0
    assert np.ptp(other.truth.com_m[:, 0]) == pytest.approx(np.ptp(here.truth.com_m[:, 0]), rel=0.05)
    np.testing.assert_array_equal(here.truth.com_m[0], robot_walk.truth.com_m[int(RATE_HZ)])


def test_an_excerpt_starts_again_at_zero_and_keeps_what_was_measured(thesis: list[StudyTrial]) -> None:
    whole = thesis[0]
    part = whole.excerpt_between(3.0, 5.0, force_s=(0.5, 1.5))
    stored = slice(600, 1000)
    np.testing.assert_array_equal(part.geometric.com_m, whole.geometric.com_m[stored])
    np.testing.assert_array_equal(part.truth.momentum_nms, whole.truth.momentum_nms[stored])
    assert part.truth.time_s[0] == part.geometric.time_s[0] == part.wrench.time_s[0] == 0.0
    assert part.wrench.complete.sum() == 201
    (window,) = part.wrench.windows
    assert (window.start_s, window.end_s) == pytest.approx((0.5, 1.5))
    np.testing.assert_array_equal(part.wrench.force_n[part.wrench.complete], whole.wrench.force_n[700:901])
    assert np.all(part.wrench.force_n[~part.wrench.complete] == 0.0)
    assert all(len(s.com_m) == 400 for s in part.geometric.segments.values())


def test_an_excerpt_may_be_the_whole_trial_and_no_sample_more(thesis: list[StudyTrial]) -> None:
    """The last sample stands for the time up to the next one; less than half a sample is none."""
    whole, end_s = thesis[0], 9.2
    same = whole.excerpt_between(-0.4 / RATE_HZ, end_s + 0.4 / RATE_HZ)
    np.testing.assert_array_equal(same.truth.com_m, whole.truth.com_m)
    np.testing.assert_array_equal(same.wrench.force_n, whole.wrench.force_n)
    for start_s, beyond_s in ((-0.6 / RATE_HZ, end_s), (0.0, end_s + 0.6 / RATE_HZ), (2.0, 2.0), (2.0, 1.0)):
        with pytest.raises(InvalidInput, match="An excerpt must lie between"):
            whole.excerpt_between(start_s, beyond_s)


def test_what_does_not_exist_is_refused(thesis: list[StudyTrial]) -> None:
    refusals = {
        "gait-unknown": lambda: clean_motion("flying"),
        "noise-unknown": lambda: simulate_trial("robot", "loud"),
        "noise-out-of-range": lambda: NoisePreset(force_n=-1.0),
        "excerpt-invalid": lambda: thesis[0].excerpt_between(8.0, 12.0),
    }
    for code, call in refusals.items():
        with pytest.raises(InvalidInput) as refusal:
            call()
        assert refusal.value.code == code
        assert refusal.value.faults


@pytest.mark.parametrize("high_pass_hz", [0.0, 5.0])
def test_noise_has_exactly_the_stated_deviation(high_pass_hz: float) -> None:
    noise = coloured_noise(np.random.default_rng(0), 1000, 4, 0.3, RATE_HZ, high_pass_hz)
    np.testing.assert_allclose(noise.std(axis=0), 0.3, rtol=1e-12)
