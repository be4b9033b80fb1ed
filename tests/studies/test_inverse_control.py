"""Weights of (4.20a) from motions: those with which motions were generated are recovered, also on people left out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stridelab.centroidal.boundary_conditions import Start
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.sequence import Contact, ContactPhase, ContactSequence
from stridelab.contacts.terrain import Terrain
from stridelab.dynamics.spatial import Placement
from stridelab.recordings.recording import Plate
from stridelab.reproduction.chapter4 import people_weights
from stridelab.reproduction.studies import human_proxy
from stridelab.reproduction.studies.human_proxy import human_proxies
from stridelab.reproduction.studies.inverse_control import (
    COMPARATORS,
    FAINT,
    GRID,
    TermWeights,
    best_candidate,
    error_ratio,
    errors_of_people,
    held_out_errors,
    prediction_error,
    weighted,
    without_term,
)
from stridelab.reproduction.studies.recorded_motions import RecordedMotion, ground_height_m, recorded_motion
from stridelab.robots.robot import Effector
from stridelab.simulation.human.body_model import build_body
from support.recorded_claims import assert_as_recorded

MEAN_OVER_SOLE, SD_OVER_SOLE = (-0.0369, 0.1055, 0.4089), (0.158, 0.1271, 0.0593)
HEIGHT_M = 0.95
SOLE = (0.12, 0.045)
CANDIDATES = tuple(
    TermWeights(1.0, momentum_rate, likelihood, force)
    for momentum_rate in (0.0, 10.0, 100.0)
    for likelihood, force in ((0.0, FAINT), (0.0, 10.0), (0.1, 10.0))
)


def two_steps(person: str, speed_m_s: float, stature_m: float) -> RecordedMotion:
    """Two steps without a motion yet: a line from end to end."""
    step_m, half_m = 0.55 * speed_m_s, 0.06 * stature_m
    places = [(-step_m / 2.0, half_m), (step_m / 2.0, -half_m), (1.5 * step_m, half_m)]
    contacts = [
        Contact(name, Placement(np.array([x, y, 0.0]), np.eye(3)), "floor", 0.8, half_size_m=SOLE)
        for name, (x, y) in zip(("left_foot", "right_foot", "left_foot"), places, strict=True)
    ]
    standing = (contacts[:1], contacts[:2], contacts[1:2], contacts[1:])
    phases = tuple(
        ContactPhase(duration_s, {contact.effector: contact for contact in on})
        for duration_s, on in zip((0.44, 0.12, 0.44, 0.12), standing, strict=True)
    )
    problem = CentroidalProblem(
        sequence=ContactSequence("two steps", "person", 0.8, Terrain(()), phases),
        mass_kg=25.0 * stature_m**2,
        effectors={
            name: Effector(name, "", "surface", Placement.identity(), contact_half_size_m=SOLE)
            for name in ("left_foot", "right_foot")
        },
        proxies=human_proxies(stature_m, "male"),
        com_start_m=np.array([-step_m / 2.0 + 0.1, 0.03, HEIGHT_M]),
        com_end_m=np.array([1.5 * step_m + 0.1, 0.03, HEIGHT_M]),
        node_rate_hz=10.0,
        contact_margin_m=(0.0, 0.0),
        control=CircularCones(),
        start=Start(np.array([1.8 * step_m, -0.12, 0.1]), np.zeros(3)),
        terminal="moving",
        end=Start(np.array([1.8 * step_m, 0.12, 0.1]), np.zeros(3)),
    )
    n = len(problem.grid().time_s)
    line = np.linspace(problem.com_start_m, problem.com_end_m, n)
    return RecordedMotion(person, problem, line, np.zeros((n - 1, 3)), np.ones(n - 1, dtype=bool))


def walked(motion: RecordedMotion, weights: TermWeights, noise_m: float, seed: int) -> RecordedMotion:
    """The motion of a person who minimises the cost with these weights, with an error of the estimate."""
    plan = solve(weighted(motion.problem, motion.height_m, weights))
    assert plan.converged, plan.status
    force_n = np.sum([f.sum(axis=1) for f in plan.forces_n.values()], axis=0)
    error_m = noise_m * np.random.default_rng(seed).standard_normal(plan.com_m.shape)
    return replace(motion, com_m=plan.com_m + error_m, force_n=force_n)


def people(weights: TermWeights, noise_m: float = 0.0) -> list[RecordedMotion]:
    return [
        walked(two_steps(name, speed_m_s, stature_m), weights, noise_m, seed)
        for seed, (name, speed_m_s, stature_m) in enumerate((("a", 1.0, 1.6), ("b", 1.2, 1.75), ("c", 1.4, 1.9)))
    ]


def quiet(_share: float, _text: str) -> None:
    """Progress that is not shown."""


@pytest.mark.parametrize("k", [3, 8])
def test_the_weights_of_simulated_people_are_found(k: int) -> None:
    """Of all people, and of those left out; with the estimate's errors too."""
    noise_m = 0.002
    names, errors = errors_of_people(people(CANDIDATES[k], noise_m), CANDIDATES, quiet)
    assert names == ("a", "b", "c")
    assert best_candidate(errors) == k
    assert held_out_errors(errors)[0] == [k, k, k]
    assert errors[:, k, :3].sum(axis=1) == pytest.approx(np.full(3, 3.0 * noise_m**2), rel=0.6)
    assert errors[:, k, 3:].sum(axis=1) == pytest.approx(np.zeros(3), abs=1e-12)


def test_people_who_minimise_one_term_alone_are_not_taken_for_others() -> None:
    """A term that generated the motions is missed where it is left out; one that did not is not."""
    _, errors = errors_of_people(people(TermWeights(1.0, 10.0)), CANDIDATES, quiet)
    held_out = held_out_errors(errors)[1] + 1e-6
    for term, missed in (("momentum_rate", True), ("likelihood", False), ("force", False)):
        columns = without_term(CANDIDATES, term)
        assert {getattr(CANDIDATES[j], term) for j in columns} <= {0.0, FAINT}
        ratio, interval = error_ratio(held_out_errors(errors[:, columns])[1] + 1e-6, held_out, "distance")
        assert interval is not None
        assert interval[0] <= ratio <= interval[1]
        assert (ratio > 1.5) == missed


def test_weights_are_those_of_the_body() -> None:
    """Twice the mass or height: the same motion in body units, a quarter of the weight of the rates."""
    weights = TermWeights(1.0, 8.0, 0.5, 2.0)
    assert weights.of_body(2.0, 1.0).momentum_rate == 2.0
    assert weights.of_body(1.0, 2.0).momentum_rate == 2.0
    assert (
        weighted(two_steps("a", 1.0, 1.7).problem, 1.0, COMPARATORS["stridelab's defaults"]).weights.point_force == 300
    )


def test_one_person_cannot_be_left_out() -> None:
    with pytest.raises(ValueError, match="only one"):
        held_out_errors(np.ones((1, 3, 6)))


def test_no_candidate_that_fails_is_chosen() -> None:
    errors = np.ones((2, 3, 6))
    errors[0, 0] = 0.0
    errors[1, 0] = np.nan
    errors[:, 2] = 0.5
    assert best_candidate(errors) == 2


def test_the_grid_leaves_every_term_out_and_gives_it_all() -> None:
    for term in ("com_acceleration", "momentum_rate", "likelihood", "force"):
        values = {getattr(weights, term) for weights in GRID}
        assert min(values) <= FAINT
        assert max(values) >= 1.0
        assert len(without_term(GRID, term)) * len(values) == len(GRID)


def test_the_density_of_a_person_lies_between_the_feet_and_scales() -> None:
    """Mirrored left and right; highest above the step, at the height of bent legs."""
    small, large = human_proxies(1.5, "male"), human_proxies(1.8, "male")
    at = np.array([[0.1, -0.1, 0.8]])
    left, right = small["left_foot"].mixture, small["right_foot"].mixture
    assert left.log_density(at) == pytest.approx(right.log_density(at * [1.0, -1.0, 1.0]))
    assert large["left_foot"].mixture.log_density(1.2 * at) == pytest.approx(left.log_density(at) - 3.0 * np.log(1.2))
    mode = right.mode_m()
    assert 0.3 * 1.5 < mode[2] < 0.58 * 1.5
    assert 0.0 < mode[1] < 0.3 * 1.5


def test_the_moment_of_a_bent_leg_is_that_of_its_triangle() -> None:
    """Independently: the knee by the law of cosines, masses at their share of thigh and shank."""
    body = build_body(1.75, 70.0, "female")
    p, inertias = body.proportions, body.model.inertias
    hip, ankle, ahead = np.array([[0.1, -0.1, 0.85]]), np.array([[0.3, -0.2, 0.12]]), np.array([[1.0, 0.0, 0.0]])
    reach_m = np.linalg.norm(ankle - hip)
    along = (ankle - hip) / reach_m
    forward = ahead - (ahead @ along.T) * along
    angle = np.arccos((p.thigh_m**2 + reach_m**2 - p.shank_m**2) / (2.0 * p.thigh_m * reach_m))
    knee = hip + p.thigh_m * (np.cos(angle) * along + np.sin(angle) * forward / np.linalg.norm(forward))
    assert np.linalg.norm(ankle - knee) == pytest.approx(p.shank_m)
    expected = np.zeros((1, 3))
    for link, start, end in (("thigh", hip, knee), ("shank", knee, ankle)):
        inertia = inertias[body.joint[f"r_{link}"]]
        share = -inertia.lever[2] / np.linalg.norm(end - start)
        assert 0.3 < share < 0.5, "of Dumas' table"
        expected += inertia.mass * (start + share * (end - start))
    foot = inertias[body.joint["r_foot"]]
    expected += foot.mass * (ankle + foot.lever)
    assert human_proxy._leg_moment(body, "r", hip, ankle, ahead) == pytest.approx(expected)


def test_standing_people_are_drawn_as_recorded() -> None:
    """Mean and scatter of the centre of mass over the right sole, as a share of the stature."""
    drawn = human_proxy.sample_standing_com(build_body(1.0, 1.0, "male"), 8000, np.random.default_rng(0))
    recorded = MEAN_OVER_SOLE, SD_OVER_SOLE
    for ours, expected in zip((drawn.mean(axis=0), drawn.std(axis=0)), recorded, strict=True):
        assert ours == pytest.approx(expected, abs=2e-4)


def test_verdicts_on_weights_need_what_a_term_explains() -> None:
    """A term that costs 4 % is not one that people minimise; one that costs 6 % is."""
    n = len(GRID)
    errors = np.ones((4, n, 6))
    best = next(k for k, each in enumerate(GRID) if each == TermWeights(1.0, 10.0, 0.1, 10.0))
    errors[:, best] = 0.9
    for term, cost in (("likelihood", 1.04), ("momentum_rate", 1.06)):
        errors[:, without_term(GRID, term)] = 0.9 * cost**2
    by_hand = {name: np.full((4, 6), 1.8 if name == "the thesis' weights" else 0.95) for name in COMPARATORS}
    result = people_weights.Predictions(errors, by_hand)
    assert result.chosen == GRID[best]
    assert result.agreeing == 4
    motions = [
        replace(two_steps(name, 1.0, 1.7), com_m=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])) for name in "abcd"
    ]
    claims = {claim.key: claim for claim in people_weights._claims(result, motions)}
    assert claims["without_likelihood"].ours == pytest.approx(1.04)
    assert claims["without_likelihood"].outcome == "aim_missed"
    assert claims["without_momentum_rate"].ours == pytest.approx(1.06)
    assert claims["without_momentum_rate"].outcome == "aim_reached"
    assert claims["over_thesis"].ours == pytest.approx(np.sqrt(0.5))
    assert claims["over_thesis"].outcome == "aim_reached"
    assert claims["over_equal"].ours == pytest.approx(np.sqrt(0.9 / 0.95))
    assert claims["over_equal"].outcome == "aim_missed"
    assert claims["force"].ours == pytest.approx(np.sqrt(0.5))
    assert claims["height"].ours == pytest.approx(np.sqrt(0.9))
    assert_as_recorded("weights-people of invented errors", claims.values())
    robot = people_weights.talos_weights(TermWeights(2.0, 3.0, 0.0, 5.0))
    assert robot["weights of people, the thesis' densities"] == TermWeights(2.0, 3.0, 0.2, 5.0)


def test_children_are_judged_with_the_weights_of_adults(monkeypatch: pytest.MonkeyPatch) -> None:
    """The ratio of the first to the second of two weights; 0.97 of the thesis' is not better."""
    predicted: list[object] = []

    def errors_of(
        motions: list[RecordedMotion], weights: list[object], _tell: object
    ) -> tuple[tuple[str, ...], object]:
        predicted.extend(weights)
        return tuple("ab"[: len(motions)]), np.array([[np.full(6, 0.97**2), np.ones(6)]] * len(motions))

    monkeypatch.setattr(people_weights, "errors_of_people", errors_of)
    chosen, children = TermWeights(1.0, 2.0), [two_steps(name, 1.0, 1.4) for name in "ab"]
    claim, stairs = people_weights._others_claims(chosen, children, children[:1])
    assert predicted == [chosen, people_weights.THESIS] * 2  # type: ignore[attr-defined]
    assert claim.ours == pytest.approx(0.97)
    assert claim.outcome == "aim_missed"
    assert claim.n == 2
    assert_as_recorded("weights-people, children", [claim, stairs])
    assert (stairs.key, stairs.n, stairs.interval) == ("stairs", 1, None), "one person has no interval"
    assert people_weights._others_claims(chosen, [], []) == []


def test_rows_are_in_metres_and_body_weights() -> None:
    """RMS over people of each axis and of their sum, in the order of the choices."""
    n = len(GRID)
    errors = np.tile(np.array([4.0, 9.0, 36.0, 0.04, 0.05, 0.16]) * 1e-6, (3, n, 1))
    errors *= np.array([0.5, 1.0, 1.5])[:, None, None]
    by_hand = dict.fromkeys(COMPARATORS, 4.0 * errors[:, 0])
    rows = people_weights._rows(people_weights.Predictions(errors, by_hand))
    assert rows["ahead_m"][0] == pytest.approx(0.002)
    assert rows["sideways_m"][0] == pytest.approx(0.003)
    assert rows["up_m"][0] == pytest.approx(0.006)
    assert rows["distance_m"][0] == pytest.approx(0.007)
    assert rows["force_body_weights"][0] == pytest.approx(0.0005)
    assert rows["distance_m"][-1] == pytest.approx(0.014)
    assert rows["weights"][-1] == "forces alone"
    grid = people_weights._grid_table(errors)
    assert grid["distance_m"] == pytest.approx(np.full(n, 0.007))
    assert grid["horizontal_m"] == pytest.approx(np.full(n, np.sqrt(13e-6)))


def test_force_is_compared_where_it_is_measured() -> None:
    """An interval without measurement is not an error, one whose force is off by the body weight counts 1."""
    motion = walked(two_steps("a", 1.0, 1.7), TermWeights(1.0), 0.0, 0)
    off = motion.force_n.copy()
    off[0, 2] += motion.problem.weight_n
    off[1] = np.nan
    measured = np.zeros(len(off), dtype=bool)
    measured[[0, 2]] = True
    result = prediction_error(replace(motion, force_n=off, measured=measured), TermWeights(1.0))
    assert result.force_share2 == pytest.approx((0.0, 0.0, 0.5), abs=1e-9)
    assert result.distance_m2 == pytest.approx(0.0, abs=1e-12)
    lifted = replace(motion, com_m=motion.com_m + np.array([0.0, 0.003, 0.004]))
    assert prediction_error(lifted, TermWeights(1.0)).distance_m2 == pytest.approx(2.5e-5, rel=1e-2)


def test_a_sole_on_stairs_lies_on_the_plate_below_its_markers() -> None:
    """Plates of neighbouring stairs overlap seen from above, and markers lie some centimetres above the sole."""

    def plate(index: int, front_m: float, height_m: float) -> Plate:
        corners = np.array([[front_m, 0, height_m], [front_m + 0.4, 0, height_m], [front_m + 0.4, 0.6, height_m],
                            [front_m, 0.6, height_m]])  # fmt: skip
        return Plate(index, 2, corners, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(3))

    stairs = [plate(1, 0.0, 0.4), plate(2, 0.3, 0.2), plate(3, 0.6, 0.0)]
    places = ((0.2, 0.44), (0.35, 0.44), (0.35, 0.25), (0.65, 0.25), (0.8, 0.04), (0.2, 0.39), (3.0, 0.5))
    heights = [ground_height_m(np.array([x, 0.3, z]), stairs) for x, z in places]
    assert heights == [0.4, 0.4, 0.2, 0.2, 0.0, 0.4, 0.0]
    assert ground_height_m(np.array([0.2, 0.3, 0.05]), [plate(1, 0.0, 0.004)]) == 0.0, "a plate in the floor"
    assert ground_height_m(np.array([0.2, 0.3, 0.05]), [plate(1, 0.0, 0.06)]) == 0.06, "a stair begins at 5 cm"
    margins = ((-0.045, 0.42), (-0.055, 0.42), (0.2, 0.383), (0.2, 0.377))
    heights = [ground_height_m(np.array([x, 0.3, z]), stairs) for x, z in margins]
    assert heights == [0.4, 0.0, 0.4, 0.0], "5 cm beside the plate, and 2 cm below its surface"


def test_a_recorded_motion_obeys_newton_between_its_nodes(gait: Path) -> None:
    """The plates' mean force gives the change of the measured velocity, from the start to the end of the problem."""
    path = next((gait / "rehazenter-adult-walking" / "2014001").glob("*_C4_*.c3d"))
    motion = recorded_motion(path)
    problem = motion.problem
    assert motion.com_m[0] == pytest.approx(problem.com_start_m)
    assert motion.com_m[-1] == pytest.approx(problem.com_end_m)
    step_s = np.diff(problem.grid().time_s)
    speeds_m_s = np.diff(motion.com_m, axis=0) / step_s[:, None]
    assert np.linalg.norm(speeds_m_s, axis=1) == pytest.approx(np.full(len(step_s), 1.2), abs=0.5)
    assert speeds_m_s[0] == pytest.approx(problem.start.com_v_m_s, abs=0.15)
    a = np.diff(speeds_m_s, axis=0) / ((step_s[1:] + step_s[:-1]) / 2.0)[:, None]
    force_n = (motion.force_n[1:] + motion.force_n[:-1]) / 2.0
    whole = motion.measured[1:] & motion.measured[:-1]
    assert whole.sum() >= 4
    assert (force_n[whole] / problem.mass_kg - [0.0, 0.0, 9.81]) == pytest.approx(a[whole], abs=0.8)
    one, two = (phase.contacts for phase in problem.sequence.phases[1::2])
    assert [set(phase.contacts) for phase in problem.sequence.phases][1] == {"left_foot", "right_foot"}
    assert one.keys() == two.keys()
