"""Plausible human numbers, and what the seed and the request change."""

from itertools import pairwise

import numpy as np
import pytest

from stridelab.errors import InvalidInput
from stridelab.simulation.human.body_model import landmark_tracks
from stridelab.simulation.human.gait_plan import double_support_fraction, plan_gait
from stridelab.simulation.human.walker import HumanWalker, Walk


def inside(walk: Walk) -> np.ndarray:
    """Samples of the recording proper."""
    return (walk.truth.time_s >= 0.0) & (walk.truth.time_s <= walk.duration_s)


def test_centre_of_mass_moves_as_in_adults_at_their_own_speed(steady_walk: Walk) -> None:
    """1.2 m/s, 1.71 m: vertical range 2 to 5 cm, sideways 2 to 6 cm, peak vertical force 1.1 to 1.35 body weight."""
    com, f = steady_walk.truth.com_m[inside(steady_walk)], steady_walk.force_n[inside(steady_walk)]
    weight = steady_walk.body.mass_kg * 9.81
    assert 0.02 < np.ptp(com[:, 2]) < 0.05
    assert 0.02 < np.ptp(com[:, 1]) < 0.06
    assert 0.50 < com[:, 2].mean() / 1.71 < 0.57
    assert 1.1 < f[:, 2].max() / weight < 1.35
    assert 0.6 < f[:, 2].min() / weight < 0.9
    assert 0.10 < f[:, 0].max() / weight < 0.30
    assert 0.10 < -f[:, 0].min() / weight < 0.30


def test_angular_momentum_changes_as_in_adults(steady_walk: Walk, man_from_rest: Walk) -> None:
    """Adults at 1.25 m/s: 13 to 25 Nm standard deviation about the sideways axis, less about the others."""
    x, y, z = steady_walk.truth.momentum_rate_nm.std(axis=0)
    assert 10.0 < y < 30.0
    assert 3.0 < x < 15.0
    assert 2.0 < z < 10.0
    assert np.all(man_from_rest.truth.momentum_rate_nm.std(axis=0) < 40.0)


@pytest.mark.parametrize("walk_name", ["steady_walk", "man_from_rest"])
def test_full_steps_walk_at_the_requested_speed(walk_name: str, request: pytest.FixtureRequest) -> None:
    walk: Walk = request.getfixturevalue(walk_name)
    start_s, end_s = (t - walk.plan.record_from_s for t in walk.plan.steady_s)
    strikes = [s.strike_s - walk.plan.record_from_s for s in walk.plan.stances]
    whole = [t for t in strikes if max(start_s, 0.0) <= t <= min(end_s, walk.duration_s)]
    x = np.interp([whole[0], whole[-1]], walk.truth.time_s, walk.truth.com_m[:, 0])
    assert (x[1] - x[0]) / (whole[-1] - whole[0]) == pytest.approx(walk.plan.speed_m_s, rel=0.05)


def test_step_length_follows_speed_and_stature() -> None:
    def step_m(height_m: float, speed_m_s: float) -> float:
        rng = np.random.default_rng(0)
        plan = plan_gait(height_m, speed_m_s, 5.0, from_rest=False, stance_width_m=0.1, rng=rng)
        strikes = [s for s in plan.stances if plan.steady_s[0] <= s.strike_s <= plan.steady_s[1]]
        mean_m = float(np.mean(np.diff([s.x_m for s in strikes])))
        assert mean_m == pytest.approx(plan.step_length_m, rel=0.02)
        return mean_m

    assert 0.62 < step_m(1.71, 1.2) < 0.74
    assert step_m(1.71, 0.6) < step_m(1.71, 1.2) < step_m(1.71, 1.6)
    assert step_m(1.3, 1.2) < step_m(1.71, 1.2) < step_m(1.9, 1.2)


def test_double_support_shrinks_with_speed() -> None:
    assert 0.18 < double_support_fraction(1.2) < 0.26
    assert double_support_fraction(0.5) > double_support_fraction(1.2) > double_support_fraction(1.8) > 0.1


def test_joints_stay_in_human_ranges(steady_walk: Walk) -> None:
    q = np.degrees(steady_walk.posture(steady_walk.truth.time_s))
    index = steady_walk.body.index
    for side in ("l_", "r_"):
        knee, flexion, inversion = (q[:, index[side + j]] for j in ("knee", "ankle_flexion", "ankle_inversion"))
        hip_yaw, hip_pitch, hip_roll = q[:, index[f"{side}hip"] : index[f"{side}hip"] + 3].T
        assert 3.0 < knee.min() < 30.0
        assert 50.0 < knee.max() < 75.0
        assert -42.0 < flexion.min() < flexion.max() < 45.0
        assert np.abs(inversion).max() < 15.0
        assert -45.0 < hip_pitch.min() < hip_pitch.max() < 30.0
        assert np.abs(hip_roll).max() < 15.0
        assert np.abs(hip_yaw).max() < 25.0


def test_feet_neither_slip_nor_sink(steady_walk: Walk) -> None:
    """Flat feet rest within 0.1 mm; heel, ball and the soles' markers never go below the ground."""
    plan, p = steady_walk.plan, steady_walk.body.proportions
    t = np.arange(0.0, steady_walk.duration_s, 0.005)
    landmarks = landmark_tracks(steady_walk.body, steady_walk.posture(t))
    for side, s in (("left", "l_"), ("right", "r_")):
        for stance in (x for x in plan.stances if x.side == side):
            flat = (t + plan.record_from_s > stance.flat_s + 0.01) & (t + plan.record_from_s < stance.heel_off_s - 0.01)
            if flat.any():
                resting = landmarks[f"{s}heel"][flat]
                assert np.ptp(resting, axis=0).max() < 1e-4
                assert resting[0, 2] == pytest.approx(0.015 * p.height_m, abs=1e-4)
        for name in ("heel", "mt1", "mt5"):
            assert landmarks[s + name][:, 2].min() > 0.004 * p.height_m


def test_toes_clear_the_ground_in_the_middle_of_the_swing(steady_walk: Walk) -> None:
    plan = steady_walk.plan
    for side, s in (("left", "l_"), ("right", "r_")):
        stances = [x for x in plan.stances if x.side == side]
        for before, after in pairwise(stances[1:]):
            middle = before.off_s + np.linspace(0.4, 0.7, 7) * (after.strike_s - before.off_s) - plan.record_from_s
            if 0.0 < middle[0] < steady_walk.duration_s:
                ball = landmark_tracks(steady_walk.body, steady_walk.posture(middle))[f"{s}mt2"][:, 2]
                assert ball.min() > 0.03


def test_quiet_standing_rests_over_the_pressure(quiet_standing: Walk) -> None:
    t = quiet_standing.truth
    f, moment = t.force_n, t.moment_nm
    cop = np.column_stack([-moment[:, 1], moment[:, 0]]) / f[:, 2:]
    np.testing.assert_allclose(cop.mean(axis=0), t.com_m[:, :2].mean(axis=0), atol=1e-3)
    assert np.abs(cop - t.com_m[:, :2]).max() < 5e-3
    assert 1e-3 < np.ptp(t.com_m[:, 0]) < 0.03, "people sway"
    assert np.abs(f[:, 2] / (t.mass_kg * 9.81) - 1.0).max() < 0.01


def test_mean_vertical_force_over_whole_strides_is_the_weight(steady_walk: Walk) -> None:
    strikes = [s.strike_s - steady_walk.plan.record_from_s for s in steady_walk.plan.stances if s.side == "left"]
    strikes_inside = [t for t in strikes if 0.0 <= t <= steady_walk.duration_s]
    t = steady_walk.truth.time_s
    mean = steady_walk.force_n[(t >= strikes_inside[0]) & (t < strikes_inside[-1]), 2].mean()
    assert mean == pytest.approx(steady_walk.body.mass_kg * 9.81, rel=0.005)


def test_seed_changes_the_walk_and_nothing_else_does() -> None:
    first, again, other = (HumanWalker(duration_s=2.0, seed=seed).walk() for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.force_n, again.force_n)
    np.testing.assert_array_equal(first.truth.com_m, again.truth.com_m)
    assert np.abs(first.force_n - other.force_n).max() > 10.0
    lengths = [np.diff([s.x_m for s in walk.plan.stances[4:8]]) for walk in (first, other)]
    assert np.abs(lengths[0] - lengths[1]).max() > 1e-3


@pytest.mark.parametrize(
    ("speed_m_s", "height_m", "mass_kg"), [(0.2, 1.71, 60.0), (1.75, 1.2, 25.0), (1.6, 1.9, 85.0), (2.0, 1.71, 60.0)]
)
def test_every_speed_keeps_both_feet_pushing(speed_m_s: float, height_m: float, mass_kg: float) -> None:
    walk = HumanWalker(height_m, mass_kg, "male", speed_m_s, 3.0, seed=3).walk()
    weight = mass_kg * 9.81
    assert walk.force_n[:, 2].min() > 0.2 * weight
    for foot in walk.feet.values():
        sideways = np.linalg.norm(foot.force_n[:, :2], axis=1)
        assert np.all(sideways <= 0.7 * foot.force_n[:, 2] + 1e-6)


REFUSED: list[dict[str, float]] = [
    {"height_m": 0.5},
    {"mass_kg": 5.0},
    {"speed_m_s": 3.0},
    {"duration_s": 0.1},
    {"seed": -1},
    {"height_m": 1.2, "speed_m_s": 2.0},
]


@pytest.mark.parametrize("wrong", REFUSED, ids=str)
def test_requests_outside_the_limits_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidInput) as refusal:
        HumanWalker(**wrong).walk()  # type: ignore[arg-type]
    assert refusal.value.code == "walker-out-of-range"
    assert refusal.value.faults[0].where in wrong
