"""Measures of motions whose values follow on paper."""

import math
from dataclasses import replace

import numpy as np
import pytest

from stridelab.conventions import GRAVITY_M_S2
from stridelab.measures import (
    FootMotion,
    Measure,
    angular_momentum_ranges,
    energy_exchange,
    extrapolated_com,
    foot_placement,
    limb_work,
    margins_of_stability,
    rolling_wheel,
    spatiotemporal,
    summarise,
    symmetry_index,
)
from stridelab.measures.energy_exchange import STEP_ERRORS, step_energies
from stridelab.measures.rolling_wheel import CORRELATION_S, VERTICAL_SHARE, wheel_sd
from stridelab.measures.spatiotemporal import HALF_STRIDE_CHANGE, timing_sd
from stridelab.measures.stated_errors import FACTORS, calibrate_errors, is_measured
from stridelab.measures.walk_motion import FOOT_SKIN_ALIKE, FOOT_SKIN_SD_M, MARKER_SD_M, PELVIS_SKIN_SD_M, WalkMotion
from stridelab.recordings.recording import Side
from stridelab.simulation.human.marker_layout import skin_displacements
from stridelab.walking.curtate_cycloid import Wheel
from stridelab.walking.event_calibration import EventError
from stridelab.walking.gait_events import Contact
from stridelab.walking.path_fit import fit_path
from support.recordings.analytic_motions import (
    FOOT_M,
    HALF_BREADTH_M,
    HALF_WIDTH_M,
    HEIGHT_M,
    MASS_KG,
    RATE_HZ,
    SPEED_M_S,
    STEP_M,
    STEP_S,
    STEPS_IN_WALK,
    SWING_S,
    plain_steps,
    plain_walk,
    side_of,
)

OMEGA_0 = math.sqrt(GRAVITY_M_S2 / HEIGHT_M)


def values(measures: list[Measure], name: str) -> list[float]:
    return [measure.value for measure in measures if measure.name == name]


def test_the_extrapolated_com_leads_by_the_speed_over_the_pendulums_rate() -> None:
    motion = plain_walk()
    xcom = extrapolated_com(motion)
    np.testing.assert_allclose(xcom.position_m[:, 0], motion.com_m[:, 0] + SPEED_M_S / OMEGA_0, atol=1e-9)
    np.testing.assert_allclose(xcom.position_m[:, 1], 0.0, atol=1e-9)
    assert xcom.sd_m is None


def test_its_error_takes_the_covariance_of_position_and_velocity() -> None:
    covariance = np.broadcast_to([[4e-6, 3e-6], [3e-6, 9e-6]], (len(plain_walk().time_s), 3, 2, 2))
    xcom = extrapolated_com(plain_walk(covariance=covariance))
    variance = 4e-6 + 2 * 3e-6 / OMEGA_0 + 9e-6 / OMEGA_0**2
    assert xcom.sd_m is not None
    np.testing.assert_allclose(xcom.sd_m, math.sqrt(variance))


def test_margins_are_the_distances_to_the_edges_of_the_feet() -> None:
    measures = margins_of_stability(plain_walk(), plain_steps())
    edge_m = HALF_WIDTH_M + HALF_BREADTH_M
    sideways, landing = (
        values(measures, "margin_of_stability_ml_min"),
        values(measures, "margin_of_stability_ml_contact"),
    )
    assert sideways == pytest.approx([edge_m] * STEPS_IN_WALK, abs=1e-6)
    assert landing == pytest.approx([edge_m] * STEPS_IN_WALK, abs=1e-6)
    ahead_m = [
        (k + 1) * STEP_M + FOOT_M - (SPEED_M_S * (k + 1) * STEP_S + SPEED_M_S / OMEGA_0) for k in range(STEPS_IN_WALK)
    ]
    assert values(measures, "margin_of_stability_ap_contact") == pytest.approx(ahead_m, abs=1e-6)


def test_factors_scale_the_error_of_the_extrapolated_com_and_not_that_of_the_foot() -> None:
    """With a state that is known exactly, what remains is the marker of the foot and its skin."""
    of_foot_m = math.hypot(MARKER_SD_M, FOOT_SKIN_SD_M)
    name = "margin_of_stability_ml_min"
    for state_m in (0.0, 0.004):
        covariance = np.broadcast_to(np.diag([state_m**2, 1e-12]), (len(plain_walk().time_s), 3, 2, 2))
        motion = plain_walk(covariance=covariance)
        raw = [one for one in margins_of_stability(motion, plain_steps()) if one.name == name]
        assert [one.events_sd for one in raw] == pytest.approx([of_foot_m] * len(raw))
        stated = calibrate_errors(motion, plain_steps(), raw)
        factor_m = [FACTORS[name][0 if is_measured(motion, plain_steps()[m.step or 0], m) else 1] for m in raw]
        expected = [math.hypot(factor * state_m, of_foot_m) for factor in factor_m]
        assert [one.sd for one in stated] == pytest.approx(expected, abs=1e-6)


def test_a_body_that_sways_outwards_has_its_smallest_margin_where_it_is_farthest_out() -> None:
    motion = plain_walk()
    sway = motion.com_m.copy()
    sway[:, 1] = 0.03 * np.sin(np.pi * (motion.time_s - STEP_S) / STEP_S)
    swaying = plain_walk(com_m=sway)
    xcom = extrapolated_com(swaying)
    for measure in margins_of_stability(swaying, plain_steps()):
        if measure.name == "margin_of_stability_ml_min":
            step = plain_steps()[measure.step or 0]
            inside = (swaying.time_s >= step.lift_off_s - 1e-9) & (swaying.time_s <= step.strike_s + 1e-9)
            outwards = 1.0 if measure.side == "left" else -1.0
            by_hand = (HALF_WIDTH_M + HALF_BREADTH_M - outwards * xcom.position_m[inside, 1]).min()
            assert measure.value == pytest.approx(by_hand, abs=1e-9)
            assert measure.side != step.side


def test_lengths_and_times_are_those_of_the_walk() -> None:
    measures = spatiotemporal(plain_walk(), plain_steps())
    expected = {
        "step_length": STEP_M,
        "step_width": 2 * HALF_WIDTH_M,
        "step_time": STEP_S,
        "cadence": 60.0 / STEP_S,
        "walking_speed": SPEED_M_S,
        "double_support_share": (STEP_S - SWING_S) / STEP_S,
        "stride_time": 2 * STEP_S,
        "stance_share": 1.0 - SWING_S / (2 * STEP_S),
        "swing_share": SWING_S / (2 * STEP_S),
        "stride_length": 2 * STEP_M,
        "com_vertical_excursion": 0.0,
        "com_lateral_excursion": 0.0,
    }
    for name, value in expected.items():
        assert values(measures, name) == pytest.approx([value] * len(values(measures, name)), abs=1e-9), name
        assert values(measures, name), name


@pytest.mark.parametrize(("phase_rad", "recovery"), [(0.0, 1.0), (np.pi, 0.0)])
def test_energy_in_opposite_phase_is_recovered_and_in_phase_is_not(phase_rad: float, recovery: float) -> None:
    """Kinetic energy ahead opposes (or joins) potential energy of the same amplitude; v_z is given as 0."""
    motion = plain_walk()
    e, turn = 0.1, 2 * np.pi * motion.time_s / STEP_S
    com = motion.com_m.copy()
    com[:, 2] = HEIGHT_M + e * np.cos(turn) / GRAVITY_M_S2
    velocity = np.zeros_like(com)
    velocity[:, 0] = np.sqrt(2.0 * (1.0 - e * np.cos(turn + phase_rad)))
    measures = energy_exchange(plain_walk(com_m=com, velocity_m_s=velocity), plain_steps())
    assert values(measures, "energy_recovery") == pytest.approx([recovery] * (STEPS_IN_WALK - 2), abs=2e-3)
    work = 0.0 if recovery == 1.0 else 2 * 2 * 2 * e
    assert values(measures, "external_work") == pytest.approx([work] * (STEPS_IN_WALK - 2), abs=5e-3)


def swinging_walk(sd_m_s: float) -> WalkMotion:
    """A walk whose CoM rises and falls by 2 cm, with a velocity of this deviation."""
    motion = plain_walk()
    com = motion.com_m.copy()
    com[:, 2] = HEIGHT_M + 0.02 * np.cos(2 * np.pi * motion.time_s / STEP_S)
    variance = np.zeros((len(com), 3, 2, 2))
    variance[:, :, 1, 1] = sd_m_s**2
    return plain_walk(com_m=com, covariance=variance)


def swinging_energies(known_from: int, sd_m_s: float = 0.004) -> tuple[list[Measure], list[Measure]]:
    """Energies of single steps of a walk, and of the same one whose first step is known from a sample on."""
    whole = swinging_walk(sd_m_s)
    assert whole.covariance is not None
    first = whole.samples(plain_steps()[1].lift_off_s, plain_steps()[1].next_lift_off_s)
    hidden = whole.covariance.copy()
    hidden[first.start : first.start + known_from, 2, 1, 1] = 0.05**2
    return step_energies(whole, plain_steps()), step_energies(replace(whole, covariance=hidden), plain_steps())


def test_a_single_step_has_an_error_to_which_missing_ends_add() -> None:
    whole, cut = ([one for one in measures if one.step == 1] for measures in swinging_energies(known_from=3))
    assert [one.name for one in whole] == ["step_energy_recovery", "step_external_work"]
    n = round(STEP_S * RATE_HZ) + 1
    for one, other in zip(whole, cut, strict=True):
        assert one.sd is not None
        assert other.sd is not None
        assert one.sd > 0.0
        scale = abs(other.value) if one.unit == "J/kg" else 1.0
        added = math.sqrt(max(other.sd**2 - one.sd**2, 0.0))
        assert added == pytest.approx(STEP_ERRORS[one.name][1] * 3 / n * scale, rel=0.35)


def test_a_step_of_which_a_tenth_is_missing_has_no_energies() -> None:
    n = round(STEP_S * RATE_HZ) + 1
    _, cut = swinging_energies(known_from=math.ceil(0.1 * n))
    assert 1 not in {one.step for one in cut}
    assert 2 in {one.step for one in cut}


def test_a_leg_that_pushes_and_brakes_works_by_force_times_velocity() -> None:
    motion = plain_walk()
    force = np.zeros_like(motion.com_m)
    force[:, 0] = np.where(motion.time_s % STEP_S < STEP_S / 2, -100.0, 50.0)
    feet = {side: FootMotion(foot.heel_m, foot.outline_m, force) for side, foot in motion.feet.items()}
    contacts = [Contact("left", STEP_S, 2 * STEP_S), Contact("right", None, 3 * STEP_S), Contact("right", STEP_S, None)]
    measures = limb_work(plain_walk(feet=feet), contacts, plain_steps())
    assert [measure.name for measure in measures] == ["limb_work_left_positive", "limb_work_left_negative"]
    pushed, braked = (measure.value for measure in measures)
    assert pushed == pytest.approx(50.0 * SPEED_M_S * STEP_S / 2 / MASS_KG, rel=0.01)
    assert braked == pytest.approx(-100.0 * SPEED_M_S * STEP_S / 2 / MASS_KG, rel=0.02)


def test_work_is_not_reported_where_the_force_of_a_leg_is_not_measured() -> None:
    motion = plain_walk()
    hidden = np.full_like(motion.com_m, np.nan)
    feet = {side: FootMotion(foot.heel_m, foot.outline_m, hidden) for side, foot in motion.feet.items()}
    assert limb_work(plain_walk(feet=feet), [Contact("left", STEP_S, 2 * STEP_S)], plain_steps()) == []


def test_ranges_of_the_angular_momentum_are_scaled_by_speed_and_stature() -> None:
    motion = plain_walk()
    momentum = np.column_stack([a * np.sin(2 * np.pi * motion.time_s / (2 * STEP_S)) for a in (0.02, 0.05, 0.01)])
    measures = angular_momentum_ranges(plain_walk(momentum_per_kg=momentum), plain_steps())
    for axis, amplitude in zip("xyz", (0.02, 0.05, 0.01), strict=True):
        expected = 2 * amplitude / (SPEED_M_S * 1.8)
        result = values(measures, f"angular_momentum_range_{axis}")
        assert result == pytest.approx([expected] * (STEPS_IN_WALK - 2), rel=1e-3)
    assert angular_momentum_ranges(plain_walk(momentum_per_kg=momentum, stature_m=None), plain_steps()) == []


def test_a_linear_law_of_foot_placement_is_recovered() -> None:
    """Feet placed by a law of the CoM's lateral state in mid-swing, with a state that differs from step to step."""
    rng = np.random.default_rng(1)
    motion = plain_walk()
    com = motion.com_m.copy()
    frequencies = rng.uniform(0.2, 1.0, 5)
    com[:, 1] = 0.01 * np.sin(2 * np.pi * np.outer(motion.time_s, frequencies) + rng.uniform(0, 6, 5)).sum(axis=1)
    swaying = plain_walk(com_m=com)
    heels = {side: foot.heel_m.copy() for side, foot in swaying.feet.items()}
    for k, step in enumerate(plain_steps()):
        middle_s = 0.5 * (step.lift_off_s + step.strike_s)
        outwards = 1.0 if step.side == "left" else -1.0
        other: Side = "right" if step.side == "left" else "left"
        y, v = (
            swaying.interpolate_track(swaying.com_m, middle_s)[1],
            swaying.interpolate_track(swaying.velocity_m_s, middle_s)[1],
        )
        standing = swaying.interpolate_track(heels[other], step.lift_off_s)[1]
        placed = y + outwards * (0.05 + 0.4 * outwards * (y - standing) + 0.2 * outwards * v)
        later = swaying.time_s > step.strike_s - 0.02
        heels[side_of(k)][later, 1] = placed
    feet = {side: FootMotion(heels[side], foot.outline_m, foot.force_n) for side, foot in swaying.feet.items()}
    law = {one.name: one.value for one in foot_placement([(plain_walk(com_m=com, feet=feet), plain_steps())])}
    assert law["foot_placement_gain_position"] == pytest.approx(0.4, abs=1e-6)
    assert law["foot_placement_gain_velocity"] == pytest.approx(0.2, abs=1e-6)
    assert law["foot_placement_residual"] == pytest.approx(0.0, abs=1e-6)
    assert foot_placement([(swaying, plain_steps(8))]) == []


def test_a_cycloid_has_the_radii_the_height_and_the_speed_of_its_wheel() -> None:
    """One turn per step; the height of the hub has the error of the height beside that of the fit."""
    plain = plain_walk()
    wheel = Wheel(R_m=STEP_M / (2.0 * math.pi), r_m=0.02, z0_m=HEIGHT_M, x0_m=0.0)
    theta = 2.0 * math.pi * (plain.time_s / STEP_S + 0.3)
    path = wheel.position_m(theta)
    com = np.column_stack([path[:, 0], np.zeros(len(path)), path[:, 1]])
    covariance = np.broadcast_to(np.diag([1e-6, 1e-4]), (len(plain.time_s), 3, 2, 2))
    motion = replace(plain, com_m=com, covariance=covariance, varying_sd_m=0.003, height_sd_m=0.02)
    measures = rolling_wheel(motion, plain_steps())
    truth = {
        "cycloid_wheel_radius": wheel.R_m,
        "cycloid_point_radius": 0.02,
        "cycloid_hub_height": HEIGHT_M,
        "cycloid_angular_speed": 2.0 * math.pi / STEP_S,
    }
    for name, value in truth.items():
        given = values(measures, name)
        assert len(given) == STEPS_IN_WALK
        assert given == pytest.approx([value] * STEPS_IN_WALK, rel=1e-4)
    heights = [one.sd for one in measures if one.name == "cycloid_hub_height"]
    assert heights == pytest.approx([0.02] * STEPS_IN_WALK, rel=0.01)
    assert all(one.sd is None for one in rolling_wheel(replace(motion, covariance=None), plain_steps()))
    assert rolling_wheel(plain, plain_steps()) == [], "a straight line is no wheel"


def test_the_errors_of_a_wheel_hold_for_errors_of_the_path_that_are_correlated_in_time() -> None:
    """Fits of 150 drawn paths: the scatter of each parameter is the stated deviation within four of its own errors."""
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, STEP_S, 0.01)
    theta = 2.0 * math.pi * (time_s / STEP_S - 0.5)
    exact = Wheel(R_m=0.11, r_m=0.02, z0_m=1.0, x0_m=0.0).position_m(theta)
    sd_m, n = 0.0005, 150
    root = np.linalg.cholesky(np.exp(-np.abs(time_s[:, None] - time_s) / CORRELATION_S))
    rows = []
    for _ in range(n):
        error = sd_m * (root @ rng.standard_normal((len(time_s), 2))) * [1.0, VERTICAL_SHARE]
        fit = fit_path(time_s, exact + error, STEP_S)
        omega = np.polyfit(time_s, fit.theta_rad, 1)[0]
        rows.append([fit.wheel.R_m, fit.wheel.r_m, fit.wheel.z0_m, omega])
    ratios = np.std(rows, axis=0) / wheel_sd(time_s, fit_path(time_s, exact, STEP_S), (sd_m, VERTICAL_SHARE * sd_m))
    assert np.abs(ratios - 1.0).max() < 4.0 / math.sqrt(2 * n)


def test_an_error_common_to_two_strikes_drops_out_of_the_time_between_them() -> None:
    markers, plates = EventError(0.009, 0.005), EventError(0.0, 0.001)
    assert timing_sd([(1.0, markers), (-1.0, markers)]) == pytest.approx(0.005 * math.sqrt(2.0))
    assert timing_sd([(1.0, markers), (-1.0, plates)]) == pytest.approx(math.sqrt(0.009**2 + 0.005**2 + 0.001**2))
    assert timing_sd([(-1.0, markers)], [(1.0, markers)]) == pytest.approx(math.sqrt(2.0 * (0.009**2 + 0.005**2)))


def test_a_step_s_length_is_as_uncertain_as_markers_on_feet_that_stand() -> None:
    """Both heels are read while they rest, so that an error of the strike, where the heel is fast, has no effect."""
    errors = {"strike_error": EventError(0.0, 0.01), "prior_strike_error": EventError(0.0, 0.01)}
    steps = [replace(step, **errors) for step in plain_steps()]
    measures = spatiotemporal(plain_walk(), steps)
    for name, skin in (("step_length", math.sqrt(2.0 * 0.6)), ("step_width", math.sqrt(2.0 * 1.4))):
        sd = [m.sd for m in measures if m.name == name][2]
        assert sd == pytest.approx(math.hypot(math.sqrt(2.0) * MARKER_SD_M, skin * FOOT_SKIN_SD_M))


def test_the_heels_of_both_feet_share_as_much_skin_as_in_the_simulation() -> None:
    """Drawn skins: the right heel half a stride later, mirrored, beside the left one."""
    rng = np.random.default_rng(5)
    phase = np.arange(24) / 12.0
    pairs = []
    for _ in range(400):
        moved = skin_displacements(phase, rng)
        pairs.append(np.stack([moved["L_FCC"][:12], moved["R_FCC"][6:18] * [1.0, -1.0, 1.0]]))
    left, right = np.moveaxis(np.array(pairs), 1, 0)
    for axis in range(3):
        shared = np.mean(left[..., axis] * right[..., axis]) / np.mean(left[..., axis] ** 2)
        assert shared == pytest.approx(FOOT_SKIN_ALIKE, abs=0.08)


def test_the_change_of_a_skin_wave_over_half_a_stride_enters_the_speed_of_a_step() -> None:
    """Drawn waves of three harmonics; over a whole stride they do not change, so that its length is without them."""
    rng = np.random.default_rng(3)
    harmonic = np.arange(1, 4)
    waves = rng.normal(size=(20_000, 3)) / harmonic, rng.normal(size=(20_000, 3)) / harmonic
    at = [waves[0] @ np.cos(np.pi * k * harmonic) + waves[1] @ np.sin(np.pi * k * harmonic) for k in (0, 1, 2)]
    assert np.std(at[1] - at[0]) / np.std(at[0]) == pytest.approx(HALF_STRIDE_CHANGE, rel=0.03)
    np.testing.assert_allclose(at[2], at[0], atol=1e-12)
    certain = {name: EventError(0.0, 0.0) for name in ("lift_off_error", "next_lift_off_error")}
    steps = [replace(step, **certain) for step in plain_steps()]
    sd = [m.sd for m in spatiotemporal(plain_walk(), steps) if m.name == "walking_speed"][2]
    duration_s = steps[2].next_lift_off_s - steps[2].lift_off_s
    change_m = math.hypot(math.sqrt(2.0) * MARKER_SD_M, HALF_STRIDE_CHANGE * PELVIS_SKIN_SD_M)
    assert sd == pytest.approx(change_m / duration_s)


def test_by_markers_alone_a_step_s_energies_have_the_factor_of_a_stride() -> None:
    motion = swinging_walk(0.004)
    alone = replace(motion, by_markers=True)
    raw = {one.name: one.sd for one in step_energies(alone, plain_steps()) if one.step == 1}
    stated = {
        m.name: m.sd for m in calibrate_errors(alone, plain_steps(), step_energies(alone, plain_steps())) if m.step == 1
    }
    for name, sd in raw.items():
        assert sd is not None
        assert stated[name] == pytest.approx(FACTORS[name][2] * sd)
        assert FACTORS[name][2] == FACTORS[name.removeprefix("step_")][2]
    for one in step_energies(motion, plain_steps()):
        if one.step == 1:
            assert one.sd == pytest.approx(STEP_ERRORS[one.name][0] * (raw[one.name] or 0.0))


def test_stated_errors_are_scaled_by_the_force_that_is_measured() -> None:
    """Factors of steps with all force measured where the velocity is certain, and the others elsewhere."""
    given = Measure("walking_speed", 1.2, 0.01, "m/s", "left", 2)
    others = [replace(given, sd=None), replace(given, step=None), replace(given, name="foot_placement_residual")]
    for velocity_sd, k in ((0.002, 0), (0.05, 1)):
        covariance = np.broadcast_to(np.diag([1e-6, velocity_sd**2]), (len(plain_walk().time_s), 3, 2, 2))
        result = calibrate_errors(plain_walk(covariance=covariance), plain_steps(), [given, *others])
        assert result[0].sd == pytest.approx(0.01 * FACTORS["walking_speed"][k])
        assert result[1:] == others


def test_a_mean_has_the_scatter_of_the_steps_and_the_common_error() -> None:
    steps = [Measure("m", value, 0.5, "m", "left", k) for k, value in enumerate((1.0, 2.0, 3.0))]
    both, left = summarise(steps)
    assert (both.side, left.side, both.n) == (None, "left", 3)
    assert (both.mean, both.between_sd, both.error_sd) == (2.0, 1.0, 0.5)
    half = math.hypot(4.302653 / math.sqrt(3), 1.96 * 0.5)
    assert both.ci95 == pytest.approx((2.0 - half, 2.0 + half), abs=1e-4)
    (single, _) = summarise(steps[:1])
    assert single.between_sd is None
    assert single.ci95 == pytest.approx((1.0 - 0.98, 1.0 + 0.98))
    for values in ((1.0,), (1.0, 2.0, 3.0)):
        unknown, _ = summarise([Measure("m", value, None, "m", "left", k) for k, value in enumerate(values)])
        assert unknown.ci95 is None, "the scatter alone would promise too much"


def test_symmetry_is_the_difference_over_the_mean() -> None:
    assert symmetry_index(1.1, 0.9) == pytest.approx(0.2)
    assert symmetry_index(0.0, 0.0) is None
