"""Two recorded steps as a problem, from invented feet, steps and forces with known places, times and means."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from stridelab.errors import NotEstimable
from stridelab.estimation.estimator import ComEstimate
from stridelab.measures.walk_motion import FootMotion, WalkMotion
from stridelab.recordings.recording import Plate, Side, WrenchTrack
from stridelab.reproduction.studies import recorded_motions
from stridelab.reproduction.studies.human_proxy import human_proxies
from stridelab.reproduction.studies.recorded_motions import recorded_motion
from stridelab.walking.steps import GaitStep

TIME_S = np.arange(0.0, 3.0, 0.001)
SPEED_M_S = {"left": 0.1, "right": -0.2}
"""Both feet creep ahead, so that a median over a part of the time says which part."""
YAW_RAD = 0.5
WALK_AXES = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
BELT_M_S = np.array([0.0, -1.2, 0.0])
SOLE_M = np.array([[-0.1, 0.03, 0.02], [-0.1, -0.03, 0.02], [0.08, 0.05, 0.01], [0.08, -0.04, 0.03], [0.16, 0.0, 0.05]])
"""Heel (2), ball (2) and tip of the toes about the ankle of a foot that points ahead."""


def outline_m(side: Side) -> np.ndarray:
    """A foot turned by ``YAW_RAD``, 0.1 m to its side of the line of the walk."""
    c, s = np.cos(YAW_RAD), np.sin(YAW_RAD)
    turned = SOLE_M @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    ankle = np.zeros((len(TIME_S), 1, 3))
    ankle[:, 0, 0] = SPEED_M_S[side] * TIME_S
    ankle[:, 0, 1] = 0.1 if side == "left" else -0.1
    return ankle + turned


def creeping_walk() -> WalkMotion:
    """A walk along the world's y axis on a belt, with known velocity and momentum of the body."""
    n = len(TIME_S)
    com = np.column_stack([0.2 * TIME_S, 0.0 * TIME_S, 0.9 + 0.1 * TIME_S])
    return WalkMotion(
        TIME_S, com, np.tile([1.1, 0.2, 0.1], (n, 1)), None, 0.002,
        {side: FootMotion(np.zeros((n, 3)), outline_m(side), np.full((n, 3), np.nan)) for side in ("left", "right")},
        np.column_stack([0.01 + 0.02 * TIME_S, 0.03 + 0.0 * TIME_S, -0.04 * TIME_S]), 70.0, 1.75,
        frame=WALK_AXES, origin_m=TIME_S[:, None] * BELT_M_S + [2.0, 3.0, 0.2],
    )  # fmt: skip


def step_of(side: Side, lift_off_s: float, strike_s: float, next_lift_off_s: float, **others: Any) -> GaitStep:
    """A measured step."""
    given = {"period_s": 0.6, "length_m": 0.6, "speed_m_s": 1.1, "measured": True, "source": "markers"} | others
    return GaitStep(side=side, lift_off_s=lift_off_s, strike_s=strike_s, next_lift_off_s=next_lift_off_s, **given)


ONE, TWO = step_of("right", 0.4, 0.8, 0.9), step_of("left", 0.9, 1.35, 1.5)


def expected_sole_m(side: Side, at_s: float) -> np.ndarray:
    """Middle of heel and tip in the axes of the walk, on the floor."""
    ahead = 0.03 * np.array([np.cos(YAW_RAD), np.sin(YAW_RAD)])
    return np.array([SPEED_M_S[side] * at_s + ahead[0], (0.1 if side == "left" else -0.1) + ahead[1], 0.0])


def plate_at(middle_m: np.ndarray, half_m: float, height_m: float) -> Plate:
    """A square plate."""
    corners = np.array([[x, y, 0.0] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) * half_m
    return Plate(1, 2, corners + np.array([*middle_m[:2], height_m]), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(3))


def test_a_sole_is_the_median_of_the_flat_foot() -> None:
    """From 30 to 60 % of a stance from 1 to 2 s: as long as from heel to tip, as broad as the ball, seen from above."""
    place, half_m = recorded_motions._sole(creeping_walk(), 1.0, 2.0, "left", ())
    assert place.position_m == pytest.approx(expected_sole_m("left", 1.45), abs=1e-6)
    c, s = np.cos(YAW_RAD), np.sin(YAW_RAD)
    assert place.rotation == pytest.approx(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    assert half_m == pytest.approx((0.13, 0.045))


def test_a_sole_has_the_height_of_the_stair_where_the_foot_is_in_the_world() -> None:
    """At the middle of the part in which it is flat, 1.45 s: the belt has moved by 1.74 m along the world's y axis."""
    walk = creeping_walk()
    middle_m = expected_sole_m("left", 1.45) @ WALK_AXES + 1.45 * BELT_M_S + [2.0, 3.0, 0.0]
    stair = plate_at(middle_m, 0.05, 0.21)
    place, _ = recorded_motions._sole(walk, 1.0, 2.0, "left", (stair,))
    assert place.position_m[2] == pytest.approx(0.21)
    for beside_m in ([0.0, 0.15, 0.0], [0.15, 0.0, 0.0]):
        place, _ = recorded_motions._sole(walk, 1.0, 2.0, "left", (plate_at(middle_m + beside_m, 0.05, 0.21),))
        assert place.position_m[2] == 0.0


def test_a_foot_of_which_one_marker_is_hidden_while_it_is_flat_is_refused() -> None:
    """Hidden now and then it is not, nor hidden at other times."""
    walk = creeping_walk()

    def hidden(samples: slice) -> WalkMotion:
        outline = walk.feet["left"].outline_m.copy()
        outline[samples, 3] = np.nan
        return replace(walk, feet={**walk.feet, "left": replace(walk.feet["left"], outline_m=outline)})

    with pytest.raises(NotEstimable, match="hidden while it is flat"):
        recorded_motions._sole(hidden(slice(1200, 1700)), 1.0, 2.0, "left", ())
    for samples in (slice(1300, 1400), slice(0, 1200), slice(1700, 3000)):
        _, half_m = recorded_motions._sole(hidden(samples), 1.0, 2.0, "left", ())
        assert half_m == pytest.approx((0.13, 0.045), abs=0.003)


@pytest.mark.parametrize(("prior_strike_s", "first_from_s"), [(None, 0.0), (0.2, 0.2)])
def test_phases_and_soles_are_those_of_two_steps(prior_strike_s: float | None, first_from_s: float) -> None:
    """Right foot swings from 0.4 to 0.8 s, left from 0.9 to 1.35 s; an unknown strike lies one swing earlier."""
    pair = replace(ONE, prior_strike_s=prior_strike_s), TWO
    sequence, effectors = recorded_motions._contact_sequence(creeping_walk(), pair, ())
    assert [phase.duration_s for phase in sequence.phases] == pytest.approx([0.4, 0.1, 0.45, 0.15])
    on = [sorted(phase.contacts) for phase in sequence.phases]
    assert on == [["left_foot"], ["left_foot", "right_foot"], ["right_foot"], ["left_foot", "right_foot"]]
    flat_s = {  # the middle of 30 and 60 % of each stance; the last is as long as the one before it
        (0, "left_foot"): first_from_s + 0.45 * (0.9 - first_from_s),
        (1, "right_foot"): 0.8 + 0.45 * 0.7,
        (3, "left_foot"): 1.35 + 0.45 * 0.7,
    }
    for (phase, name), at_s in flat_s.items():
        side: Side = "left" if name == "left_foot" else "right"
        contact = sequence.phases[phase].contacts[name]
        assert contact.effector == name
        assert contact.placement.position_m == pytest.approx(expected_sole_m(side, at_s), abs=3e-4)
        assert contact.half_size_m == pytest.approx((0.13, 0.045))
        assert contact.friction == 0.8
    assert sequence.phases[2].contacts["right_foot"] is sequence.phases[1].contacts["right_foot"]
    assert sequence.phases[1].contacts["left_foot"] is sequence.phases[0].contacts["left_foot"]
    assert effectors.keys() == {"left_foot", "right_foot"}
    for name, effector in effectors.items():
        assert effector.name == name
        assert effector.contact_half_size_m == pytest.approx((0.13, 0.045))


def test_the_first_pair_follows_without_a_gap_and_within_the_estimate() -> None:
    """An estimate from exactly the first lift-off to exactly the last; rounding errors are no gap."""
    estimate = Mock(spec=ComEstimate, time_s=np.array([0.4, 0.7, 1.0, 1.5]))
    assert recorded_motions._first_pair([ONE, TWO], estimate) == (ONE, TWO)
    early, late = replace(ONE, lift_off_s=0.39), replace(TWO, next_lift_off_s=1.51)
    refused = (
        [early, TWO], [ONE, late], [replace(ONE, measured=False), TWO], [ONE, replace(TWO, side="right")],
        [ONE, replace(TWO, lift_off_s=0.9 + 1.2e-6)], [ONE, replace(TWO, lift_off_s=0.9 - 1.2e-6)], [ONE],
    )  # fmt: skip
    for steps in refused:
        assert recorded_motions._first_pair(steps, estimate) is None
    nearly = replace(TWO, lift_off_s=0.9 + 0.8e-6)
    assert recorded_motions._first_pair([ONE, nearly], estimate) == (ONE, nearly)
    three = step_of("right", 1.5, 1.9, 2.0)
    whole = Mock(spec=ComEstimate, time_s=np.array([0.0, 3.0]))
    assert recorded_motions._first_pair([replace(ONE, measured=False), TWO, three], whole) == (TWO, three)


def wrench_track(time_s: np.ndarray, force_n: np.ndarray, complete: np.ndarray) -> WrenchTrack:
    """A force without moment."""
    return WrenchTrack(time_s, force_n, np.zeros_like(force_n), complete, ())


def test_forces_are_means_over_intervals_in_the_axes_of_the_walk() -> None:
    """The last sample of an interval belongs to the next one; one missing sample leaves the whole interval out."""
    time_s = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    force_n = np.array([[0.0, 10.0, 700.0], [20.0, 30.0, 800.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0],
                        [1e6, 1e6, 1e6]])  # fmt: skip
    complete = np.array([True, True, True, False, True, True])
    nodes_s = np.array([0.0, 0.2, 0.4, 0.5, 0.51, 0.7])
    force, measured = recorded_motions._mean_forces(
        wrench_track(time_s, force_n, complete), nodes_s, replace(creeping_walk(), frame=WALK_AXES)
    )
    assert measured.tolist() == [True, False, True, True, False]
    assert force[0] == pytest.approx([20.0, -10.0, 750.0]), "ahead is the world's y axis"
    assert force[2] == pytest.approx([8.0, -7.0, 9.0])
    assert np.isnan(force[[1, 4]]).all()
    assert force.shape == (5, 3)


@pytest.fixture
def invented(monkeypatch: pytest.MonkeyPatch) -> Mapping[str, Any]:
    """A recording whose walk, steps, estimate and latency are invented; what the functions are called with."""
    calls: dict[str, Any] = {"significant": True, "walk": creeping_walk(), "steps": [ONE, TWO]}
    subject = SimpleNamespace(height_m=1.75, sex="female")
    calls["recording"] = SimpleNamespace(markers_m={}, subject=subject, plates=())
    force_n = np.tile([5.0, 7.0, 686.0], (len(TIME_S), 1))

    def total_wrench(latency_s: float) -> WrenchTrack:
        calls.setdefault("latencies_s", []).append(latency_s)
        return wrench_track(TIME_S, force_n, np.ones(len(TIME_S), dtype=bool))

    def smoother(**options: object) -> SimpleNamespace:
        calls["smoother"] = options
        return SimpleNamespace(estimate=lambda *_: Mock(spec=ComEstimate, time_s=TIME_S))

    def timed(name: str) -> Any:
        def call(*_: object, latency_s: float, **__: object) -> object:
            calls[name] = latency_s
            return calls.get(name.partition("_")[2], [])

        return call

    walk = SimpleNamespace(person="a", recording=calls["recording"], mass_kg=70.0, geometric=None, windows=(),
                           total_wrench=total_wrench)  # fmt: skip
    for name, thing in {
        "RecordedWalk": SimpleNamespace(from_file=lambda _: walk),
        "estimate_latency": lambda *_: SimpleNamespace(latency_s=0.018, significant=calls["significant"]),
        "Smoother": smoother,
        "identify": lambda _: SimpleNamespace(landmarks={}),
        "find_contacts": timed("of_contacts"),
        "find_steps": timed("of_steps"),
        "walk_motion": lambda *_, **__: calls["walk"],
    }.items():
        monkeypatch.setattr(recorded_motions, name, thing)
    return calls


def test_a_problem_has_the_ends_mass_and_forces_of_the_person(invented: Mapping[str, Any]) -> None:
    """From the lift-off at 0.4 s to that at 1.5 s, 25 nodes a second."""
    motion = recorded_motion(Path("a.c3d"))
    problem = motion.problem
    assert motion.person == "a"
    assert problem.mass_kg == 70.0
    assert problem.node_rate_hz == 25.0
    assert problem.com_start_m == pytest.approx([0.08, 0.0, 0.94])
    assert problem.com_end_m == pytest.approx([0.3, 0.0, 1.05])
    assert motion.height_m == pytest.approx((0.94 + 1.05) / 2.0)
    assert motion.com_m[[0, -1]] == pytest.approx(np.array([[0.08, 0.0, 0.94], [0.3, 0.0, 1.05]]))
    assert motion.com_m[:, 2] == pytest.approx(0.94 + 0.1 * problem.grid().time_s)
    assert problem.contact_margin_m == (0.0, 0.0)
    assert problem.end is not None
    for state, at_s in ((problem.start, 0.4), (problem.end, 1.5)):
        assert state.com_v_m_s == pytest.approx([1.1, 0.2, 0.1])
        assert state.l_nms == pytest.approx(70.0 * np.array([0.01 + 0.02 * at_s, 0.03, -0.04 * at_s]))
    assert motion.measured.all()
    assert motion.force_n == pytest.approx(np.tile([7.0, -5.0, 686.0], (len(motion.com_m) - 1, 1)))
    assert invented["smoother"] == {"beyond_window": True}, "double support after the last plate is part of the steps"
    at = np.array([[0.1, 0.1, 0.9]])
    expected, other = (human_proxies(1.75, sex)["left_foot"].mixture.log_density(at) for sex in ("female", "male"))
    density = problem.proxies["left_foot"].mixture.log_density(at)
    assert density == pytest.approx(expected, rel=1e-9)
    assert abs(density - other) > 1e-6


@pytest.mark.parametrize(("significant", "latency_s"), [(True, 0.018), (False, 0.0)])
def test_a_delay_counts_everywhere_if_it_is_significant(
    invented: dict[str, Any], significant: bool, latency_s: float
) -> None:
    invented["significant"] = significant
    recorded_motion(Path("a.c3d"))
    assert invented["latencies_s"] == [latency_s]
    assert (invented["of_contacts"], invented["of_steps"]) == (latency_s, latency_s)


def test_what_has_no_two_steps_or_hides_a_segment_is_refused(invented: dict[str, Any]) -> None:
    """One hidden axis of the velocity or the momentum is enough; without a height there is no density."""
    walk: WalkMotion = invented["walk"]
    for track in ("velocity_m_s", "momentum_per_kg"):
        values = getattr(walk, track).copy()
        values[1400:, 1] = np.nan
        invented["walk"] = replace(walk, **{track: values})
        with pytest.raises(NotEstimable, match="segment is hidden"):
            recorded_motion(Path("a.c3d"))
    invented["walk"] = walk
    for name, lacking in (("steps", [ONE]), ("walk", None)):
        given, invented[name] = invented[name], lacking
        with pytest.raises(NotEstimable, match="no two consecutive steps"):
            recorded_motion(Path("a.c3d"))
        invented[name] = given
    invented["recording"].subject.height_m = None
    with pytest.raises(NotEstimable, match="no two consecutive steps"):
        recorded_motion(Path("a.c3d"))
