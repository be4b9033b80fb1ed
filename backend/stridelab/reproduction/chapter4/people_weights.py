"""Which terms of (4.20a) people minimise when they walk: its weights by inverse optimal control, judged on others.

Adults at a comfortable and a fast speed (Schreiber and Moissenet 2019) for the fit, person by person left out; children
of another laboratory as people whose weights were not fitted at all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import Weights
from stridelab.centroidal.solver import solve
from stridelab.conventions import Progress
from stridelab.errors import NotFound
from stridelab.reproduction.claims import Claim, Column, Reproduction, target
from stridelab.reproduction.common.recorded_walks import LeftOut, left_out_text, read_each
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg
from stridelab.reproduction.studies.inverse_control import (
    COMPARATORS,
    FAINT,
    GRID,
    THESIS,
    Errors,
    TermWeights,
    best_candidate,
    error_ratio,
    errors_of_people,
    held_out_errors,
    weighted,
    without_term,
)
from stridelab.reproduction.studies.recorded_motions import RecordedMotion, recorded_motion
from stridelab.reproduction.studies.thesis_experiments import flat_walk_problem

NAME: Final = "weights-people"
TITLE: Final = "Weights of (4.20a) with which people walk"
PRINTED: Final = ("predictions", "talos")
ADULTS: Final = tuple(f"rehazenter-adult-walking/*/*_{speed}_*.c3d" for speed in ("C4", "C5"))
CHILDREN: Final = "biomechzoo-sample-study/*/Straight*.c3d"
STAIRS: Final = "pycgm-stairs/Movement*.c3d"
"""A person who descends four stairs with a plate on each."""
TERMS: Final[Mapping[str, str]] = {
    "com_acceleration": "the accelerations",
    "momentum_rate": "the rates of angular momentum",
    "likelihood": "the densities",
    "force": "the forces (our regulariser)",
}
"""Fields of ``TermWeights`` in words."""
FAR_MM: Final = 50.0
"""Errors beyond this are not drawn."""
NEEDED: Final = 1.05
"""Ratio of the distances without and with a term from which people are said to minimise it; its inverse is the ratio
from which weights are said to predict better."""
RULE: Final = "chosen on all other people"


@dataclass(frozen=True, eq=False)
class Predictions:
    """Errors of all candidates on the adults, and of the comparators."""

    grid: Errors
    by_hand: Mapping[str, Float[np.ndarray, "people 6"]]

    @property
    def chosen(self) -> TermWeights:
        """The weights chosen on all adults."""
        return GRID[best_candidate(self.grid)]

    @property
    def held_out(self) -> Float[np.ndarray, "people 6"]:
        """Errors on each adult with the weights chosen on the others."""
        return held_out_errors(self.grid)[1]

    @property
    def agreeing(self) -> int:
        """For how many adults the choice on all others is that on all."""
        return sum(GRID[k] == self.chosen for k in held_out_errors(self.grid)[0])

    @property
    def across(self) -> Float[np.ndarray, "people 6"]:
        """The same with weights chosen by the horizontal distance."""
        return held_out_errors(self.grid, "horizontal")[1]

    def without(self, term: str, part: str = "distance") -> Float[np.ndarray, "people 6"]:
        """Errors with the choice, by one of ``PARTS``, among the candidates that leave ``term`` out."""
        return held_out_errors(self.grid[:, without_term(GRID, term)], part)[1]


def run(gait: Path, tell: Progress, seed: int = 0) -> Reproduction:
    """All adults below the folder ``gait``, and its children if there are any; ``seed`` draws postures.

    Raises ``NotFound`` (``recordings-missing``) without two adults whose steps can be planned.
    """
    adults, left_out = _read_motions(gait, ADULTS, seed)
    if len({motion.person for motion in adults}) < 2:
        raise NotFound("recordings-missing", "Weights are judged on other people than those of the fit: two at least.")
    people, grid = errors_of_people(adults, GRID, lambda share, text: tell(0.05 + 0.85 * share, text))
    predictions = Predictions(grid, _by_hand(adults))
    (children, no_children), (stairs, no_stairs) = (
        _read_motions(gait, (pattern,), seed) for pattern in (CHILDREN, STAIRS)
    )
    tell(0.95, "children and TALOS")
    rows = _rows(predictions)
    robot = {name: _talos_plan(weights) for name, weights in talos_weights(predictions.chosen).items()}
    shown = adults[0]
    plans = {
        "planned, weights of people": solve(weighted(shown.problem, shown.height_m, predictions.chosen)),
        "planned, thesis' weights": solve(weighted(shown.problem, shown.height_m, THESIS)),
    }
    w = predictions.chosen
    return Reproduction(
        claims=(*_claims(predictions, adults), *_others_claims(predictions.chosen, children, stairs)),
        note=f"Two consecutive steps of {len(people)} adults at two speeds ({len(adults)} recordings, {len(left_out)} "
        f"refused), {len(GRID)} candidates, each person predicted with the weights {RULE}. Contacts, durations and the "
        "states at both ends are the person's; the centre of mass in between is compared with the smoother's, the "
        "force with the plates'. On all adults the choice is "
        f"{_shown_weight(w.com_acceleration)} |c''|², {_shown_weight(w.momentum_rate)} |L'/(m h)|², "
        f"{_shown_weight(w.likelihood)} log p, {_shown_weight(w.force)} |f/(m g)|²; without one of them it is the same "
        f"for {predictions.agreeing} of {len(people)}. TALOS' rows are plans of its flat "
        f"walk, simulated.{left_out_text([*left_out, *no_children, *no_stairs])}",
        tables={"predictions": rows, "talos": _talos_table(robot), "grid": _grid_table(grid)},
        drawing=render_svg(*_panels(predictions, shown, plans)),
        references=("carpentier2017thesis", "mombaur2010", "herr2008"),
    ).with_basis("people", len(people))


def _read_motions(gait: Path, patterns: Sequence[str], seed: int) -> tuple[list[RecordedMotion], list[LeftOut]]:
    """Motions of all recordings that match, and the recordings without one."""
    return read_each(
        (path for pattern in patterns for path in sorted(gait.glob(pattern))), partial(recorded_motion, seed=seed)
    )


def _by_hand(motions: Sequence[RecordedMotion]) -> Mapping[str, Float[np.ndarray, "people 6"]]:
    errors = errors_of_people(motions, list(COMPARATORS.values()), lambda _share, _text: None)[1]
    return {name: errors[:, k] for k, name in enumerate(COMPARATORS)}


def _claims(predictions: Predictions, motions: Sequence[RecordedMotion]) -> list[Claim]:
    """How far the chosen weights predict, against each comparator and without each term."""
    held_out, claims = predictions.held_out, []
    for key, name in (("over_thesis", "the thesis' weights"), ("over_equal", "equal weights")):
        ratio, interval = error_ratio(held_out, predictions.by_hand[name], "distance")
        claims.append(
            target(key, ratio, "1", at_most=1.0 / NEEDED).says(
                f"adults: distance of the planned from the measured centre of mass, weights {RULE} over {name}",
                interval=interval,
                comparator=name,
            )
        )
    for term, words in TERMS.items():
        ratio, interval = error_ratio(predictions.without(term), held_out, "distance")
        across, range_across = error_ratio(predictions.without(term, "horizontal"), predictions.across, "horizontal")
        low, high = range_across or (across, across)
        claims.append(
            target(f"without_{term}", ratio, "1", at_least=NEEDED).says(
                f"adults: the same distance without {words}, over that with all terms",
                "The other weights are chosen anew. "
                f"Chosen and judged horizontally: {across:.2f} [{low:.2f}, {high:.2f}].",
                interval=interval,
                comparator="all terms",
            )
        )
    spread = _height_spread(motions)
    flat, interval = error_ratio(held_out, spread, "vertical")
    claims.append(
        target("height", flat, "1", at_most=1.0).says(
            "adults: vertical error of the chosen weights over the standard deviation of the height within the steps",
            "The mean height of the person's own two steps has 1.",
            interval=interval,
            comparator="the mean height",
        )
    )
    ratio, interval = error_ratio(held_out, predictions.by_hand["the thesis' weights"], "force")
    claims.append(
        target("force", ratio, "1", at_most=1.0 / NEEDED).says(
            f"adults: error of the contact force, weights {RULE} over the thesis' weights",
            "The weights were chosen by the centre of mass.",
            interval=interval,
            comparator="the thesis' weights",
        )
    )
    return claims


def _others_claims(
    chosen: TermWeights, children: Sequence[RecordedMotion], stairs: Sequence[RecordedMotion]
) -> list[Claim]:
    """The adults' weights on people of other laboratories, none of whose recordings chose them."""
    claims = []
    for key, who, motions in (
        ("children", "children of another laboratory", children),
        ("stairs", "descending stairs, a person of a third laboratory", stairs),
    ):
        if not motions:
            continue
        people, errors = errors_of_people(motions, [chosen, THESIS], lambda _share, _text: None)
        ratio, interval = error_ratio(errors[:, 0], errors[:, 1], "distance")
        across, _ = error_ratio(errors[:, 0], errors[:, 1], "horizontal")
        up, _ = error_ratio(errors[:, 0], errors[:, 1], "vertical")
        claims.append(
            target(key, ratio, "1", at_most=1.0 / NEEDED).says(
                f"{who}: the same distance, weights chosen on the adults over the thesis' weights",
                f"Horizontally {across:.2f}, vertically {up:.2f}.",
                n=len(people),
                interval=interval,
                comparator="the thesis' weights",
            )
        )
    return claims


def _height_spread(motions: Sequence[RecordedMotion]) -> Float[np.ndarray, "people 6"]:
    """Variance of the height within the steps of each person, in the column of the vertical error."""
    of_person: dict[str, list[float]] = {}
    for motion in motions:
        of_person.setdefault(motion.person, []).append(float(np.var(motion.com_m[:, 2])))
    spread = np.zeros((len(of_person), 6))
    spread[:, 2] = [np.mean(of_person[person]) for person in sorted(of_person)]
    return spread


def _rows(predictions: Predictions) -> dict[str, Column]:
    """RMS errors over the people: distance and its parts in mm, force in percent of body weight."""
    rows = {RULE: predictions.held_out, f"{RULE} by the horizontal distance": predictions.across}
    rows |= {f"{RULE}, without {words}": predictions.without(term) for term, words in TERMS.items()}
    rows |= predictions.by_hand
    errors = np.array(list(rows.values())).mean(axis=1)
    return {
        "weights": np.array(list(rows)),
        "ahead_m": np.sqrt(errors[:, 0]),
        "sideways_m": np.sqrt(errors[:, 1]),
        "up_m": np.sqrt(errors[:, 2]),
        "distance_m": np.sqrt(errors[:, :3].sum(axis=1)),
        "force_body_weights": np.sqrt(errors[:, 3:].sum(axis=1)),
    }


def _grid_table(grid: Errors) -> dict[str, Column]:
    """All candidates with their mean errors over the adults."""
    mean = grid.mean(axis=0)
    return {
        **{term: np.array([getattr(weights, term) for weights in GRID]) for term in TERMS},
        "distance_m": np.sqrt(mean[:, :3].sum(axis=1)),
        "horizontal_m": np.sqrt(mean[:, :2].sum(axis=1)),
        "force_body_weights": np.sqrt(mean[:, 3:].sum(axis=1)),
    }


def talos_weights(of_people: TermWeights) -> Mapping[str, TermWeights | Weights]:
    """Weights with which TALOS walks: the thesis', those of people, and these with the thesis' weight of the densities.

    The latter is a tenth of that of the accelerations.
    """
    share = THESIS.likelihood / THESIS.com_acceleration * of_people.com_acceleration
    return {
        "the thesis' weights": THESIS,
        "weights of people": of_people,
        "weights of people, the thesis' densities": replace(of_people, likelihood=max(share, of_people.likelihood)),
    }


def _talos_plan(weights: TermWeights | Weights) -> CentroidalPlan:
    """Flat walk of TALOS with these weights."""
    problem = flat_walk_problem()
    return solve(weighted(problem, float(problem.com_start_m[2]), weights))


def _talos_table(plans: Mapping[str, CentroidalPlan]) -> dict[str, Column]:
    """What the weights change in TALOS' flat walk, over the middle of it."""
    rows = []
    for plan in plans.values():
        n = len(plan.time_s)
        middle, between = slice(n // 4, 3 * n // 4), slice(n // 4, 3 * n // 4 - 1)
        rates_nm = np.diff(plan.l_nms, axis=0) / np.diff(plan.time_s)[:, None]
        speed = plan.com_v_m_s[middle, 0]
        up = np.sum([f.sum(axis=1) for f in plan.forces_n.values()], axis=0)[between, 2]
        rows.append((
            float(np.ptp(plan.com_m[middle, 1])), float(np.ptp(plan.com_m[middle, 2])),
            float(np.ptp(speed) / speed.mean()), float(np.sqrt(np.mean(rates_nm[between] ** 2, axis=0).sum())),
            float(np.std(up) / up.mean()),
        ))  # fmt: skip
    names = ("sway_m", "height_range_m", "speed_range_share", "momentum_rate_nm", "vertical_force_sd_share")
    return {"weights": np.array(list(plans)), **dict(zip(names, np.array(rows).T, strict=True))}


def _panels(predictions: Predictions, shown: RecordedMotion, plans: Mapping[str, CentroidalPlan]) -> list[Panel | Bars]:
    """Errors per choice of weights, and one person's path from above and its height."""
    rows = _rows(predictions)
    t = shown.problem.grid().time_s
    tracks = {"measured": shown.com_m} | {name: plan.com_m for name, plan in plans.items()}
    distance_mm = (1e3 * rows["distance_m"]).tolist()
    return [
        Bars(
            "Distance from the measured centre of mass, RMS over people",
            "mm",
            [(name, mm) for name, mm in zip(rows["weights"].tolist(), distance_mm, strict=True) if mm < FAR_MM],
        ),
        *(
            Panel(
                title, "time (s)", "m", [Curve(t, at[:, axis], name, k) for k, (name, at) in enumerate(tracks.items())]
            )
            for title, axis in (("One person: to the left", 1), ("One person: height", 2))
        ),
    ]


def _shown_weight(weight: float) -> str:
    return "0" if weight <= FAINT else f"{weight:.3g}"
