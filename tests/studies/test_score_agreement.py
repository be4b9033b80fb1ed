"""Agreement of scores with the truth: on made-up scores whose agreement is known, and on one drawn person."""

from typing import Any, cast

import numpy as np
import pytest

from experiments.score_agreement import ESTIMATORS, ScoredDraw, score_agreement, score_draw

NAMES = tuple("abcde")


def made_up(seed: int, noise: float) -> ScoredDraw:
    """True mean squares that differ by half from one estimator to the next, and scores of them."""
    rng = np.random.default_rng(seed)
    true = 1.5 ** np.arange(5)
    scores = {}
    for k, name in enumerate(NAMES):
        seen = true[k] * np.exp(noise * rng.normal())
        scores[name] = {
            "truth": [true[k]] * 3,
            "same": [2 * true[k] + 1] * 3,
            "noisy": [seen] * 3,
            "turned": [-true[k]] * 3,
        }
        if seed % 2 == 0:
            scores[name]["rare"] = [true[k]] * 3
    return ScoredDraw(seed, "walk", False, [0.0, 0.0], scores)


@pytest.mark.parametrize(("score", "agrees"), [("same", 1.0), ("turned", 0.0)])
def test_a_score_that_orders_as_the_truth_does_and_one_that_turns_it_round(score: str, agrees: float) -> None:
    agreement = score_agreement([made_up(seed, 0.0) for seed in range(20)], score, (0, 1))
    assert agreement.rank_correlation == pytest.approx(2 * agrees - 1)
    assert agreement.pairs == agrees
    assert set(agreement.same_order.values()) == {agrees}
    assert set(agreement.same_best.values()) == {agrees}


def test_groups_average_the_noise_of_a_score() -> None:
    agreement = score_agreement([made_up(seed, 0.5) for seed in range(200)], "noisy", (0,))
    assert agreement.same_order[1] < 0.4
    assert agreement.same_order[40] > 0.9
    assert agreement.same_best[1] < agreement.same_best[10] < agreement.same_best[40] + 1e-9


def test_equal_estimators_have_no_order_and_any_of_them_is_best() -> None:
    draws = [made_up(seed, 0.0) for seed in range(5)]
    for draw in draws:
        for name in NAMES:
            scores = dict(draw.scores[name])
            cast(dict[str, Any], draw.scores)[name] = scores | {"truth": [1.0 + 0.01 * NAMES.index(name)] * 3}
    agreement = score_agreement(draws, "turned", (2,))
    assert agreement.same_order[1] == 1.0
    assert agreement.same_best[1] == 1.0


def test_draws_without_a_score_are_left_out() -> None:
    assert score_agreement([made_up(seed, 0.0) for seed in range(10)], "rare", (0,)).draws == 5


def test_one_drawn_person_has_every_score_of_every_estimator() -> None:
    draw = score_draw(1004)
    assert draw.movement == "stand"
    assert set(draw.scores) == set(ESTIMATORS)
    for of_one in draw.scores.values():
        assert {"truth", "held-back force", "one plate hidden, metres", "force path", "force path, penalty"} <= set(
            of_one
        )
        assert "flights withheld" not in of_one
        assert all(len(values) == 3 and np.isfinite(values).all() for values in of_one.values())
    assert draw.scores["geometry"]["force path"][:2] == pytest.approx(
        draw.scores["geometry"]["force path, penalty"][:2]
    )
