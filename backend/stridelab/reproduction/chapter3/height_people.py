"""R and r against height and speed over the people of several laboratories: one hierarchical model, stated in advance.

For walk j of person i in laboratory k, with the means of R (or r) and of the speed v over the steps of the walk, the
stature h and the Froude number Fr = v^2 / (g l), l = 0.53 h (Winter 1990):

    log R_ij = a_k + b log(h_i / 1.73 m) + c log Fr_ij + u_i + e_ij,   u ~ N(0, tau^2),   e ~ N(0, sigma^2).

Bodies that move alike at one Froude number have b = 1. The thesis' coefficients are of sixteen people at one speed:
what they should be follows from the model by drawing sixteen such people many times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Progress, Series
from stridelab.errors import NotEstimable, NotFound, StridelabError, UnreadableFile
from stridelab.reproduction.chapter3.people_parameter_claims import THESIS_R
from stridelab.reproduction.chapter3.people_walks import FittedWalk, fit_walk
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, above, at_least
from stridelab.reproduction.common.recorded_walks import STATICS, LeftOut, RecordedWalk, left_out_text
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.walking.population.mixed_model import MixedModel, fit_mixed_model

NAME: Final = "height-people"
TITLE: Final = "R and r against height and speed, people of several laboratories"
PRINTED: Final = ("effects", "laboratories", "refused")
LEG_SHARE: Final = 0.53
"""Length of the leg over the stature (Winter 1990)."""
REFERENCE_M: Final = 1.73
ADULT_M: Final = 1.5
"""Stature from which a laboratory's people are like those of the thesis."""
MAX_TURN_RAD: Final = np.radians(15.0)
"""Change of heading between the first and the last second of a step up to which a walk is straight."""
GROUPS: Final = ((12, 1.74, 0.04), (4, 1.71, 0.04))
"""The thesis' people: number, mean and standard deviation of the stature (m), men and women (section 3.2.1)."""
TRIALS: Final = 10
"""Trials per person in the thesis (section 3.2.1)."""
DRAWS: Final = 10_000
"""Refits of the model on people drawn with replacement."""
PREDICTIONS: Final = 20
"""Coefficients of sixteen people per refit."""
STANDARD_ERRORS_95: Final = 1.96
UNLIKELY: Final = 0.05
"""Two-sided probability below which a coefficient of the thesis is not one of the model's."""
LETTERS: Final = ("R", "r")
SHARES: Final = np.linspace(0.0, 1.0, 501)
"""Shares of the draws in the drawing."""
SPOT: Final = 0.01
"""Half of the height of a stroke in the drawing over its value."""


@dataclass(frozen=True)
class WalkMeans:
    """One straight walk of a person: means over its steps, ``values_m`` by letter."""

    laboratory: str
    person: str
    height_m: float
    speed_m_s: float
    values_m: Mapping[str, float]

    @property
    def froude_number(self) -> float:
        """v^2 / (g l)."""
        return self.speed_m_s**2 / (GRAVITY_M_S2 * LEG_SHARE * self.height_m)


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The model of one parameter, and its refits on people drawn with replacement within each laboratory.

    A row of ``refits`` is b, c, tau, sigma; one of ``predicted_r`` are coefficients of sixteen people of that refit.
    """

    letter: str
    model: MixedModel
    refits: Float[np.ndarray, "draws 4"]
    predicted_r: Float[np.ndarray, "draws predictions"]

    def exponent_interval(self, column: int) -> tuple[float, float]:
        """95 % interval of the exponent b (0) or c (1) over the refits."""
        low, high = np.percentile(self.refits[:, column], (2.5, 97.5)).tolist()
        return low, high

    @property
    def two_sided_probability(self) -> float:
        """Two-sided probability of a coefficient at least as far out as the printed one."""
        return 2.0 * float(self._shares_farther_out().mean())

    @property
    def probability_interval(self) -> tuple[float, float]:
        """95 % interval of that probability, which so many refits leave open: two standard errors of their mean."""
        shares = self._shares_farther_out()
        half = 2.0 * STANDARD_ERRORS_95 * float(shares.std(ddof=1) / np.sqrt(len(shares)))
        return max(0.0, self.two_sided_probability - half), min(1.0, self.two_sided_probability + half)

    def _shares_farther_out(self) -> Series:
        """Share of each refit's coefficients on the rarer side of the printed one."""
        above_it = (self.predicted_r >= THESIS_R[f"{self.letter}_m"]).mean(axis=1)
        return np.asarray(above_it if above_it.mean() <= 0.5 else 1.0 - above_it)


def run(gait: Path, tell: Progress, seed: int = 0) -> Reproduction:
    """All recordings ``LABORATORY/PERSON/...`` below the folder ``gait``; ``seed`` draws the people of the refits.

    Raises ``NotFound`` (``recordings-missing``) if no laboratory has three adults with a walk each, or where the model
    cannot be fitted.
    """
    walks, refused, unreadable = collect_walks(gait, tell)
    people = sorted({(walk.laboratory, walk.person) for walk in walks})
    try:
        hierarchies = [fit_hierarchy(walks, letter, seed) for letter in LETTERS]
    except NotEstimable as error:
        raise NotFound(
            "recordings-missing", f"The walks below {gait.name} are too few for the model: {error}"
        ) from error
    return Reproduction(
        claims=tuple(claim for each in hierarchies for claim in _claims(each, walks, len(people))),
        note=f"{len(walks)} straight walks of {len(people)} people, {len({lab for lab, _ in people})} laboratories; "
        "the smoother's centre of mass with the latency corrected. log R = a(laboratory) + b log h + c log Fr + "
        "u(person), restricted maximum likelihood; intervals: people drawn with replacement within their laboratory. "
        f"Predicted coefficients: sixteen people of the thesis' statures, {TRIALS} trials each, "
        f"{PREDICTIONS} times for each of {DRAWS} refits."
        f"{left_out_text(unreadable)}",
        tables={
            "effects": _effects_table(hierarchies),
            "laboratories": _laboratory_table(walks),
            "refused": _refused_table(refused),
            "walks": _walk_table(walks),
        },
        drawing=render_svg(*_panels(walks, hierarchies)),
    ).with_basis("people", len(people))


def collect_walks(gait: Path, tell: Progress) -> tuple[list[WalkMeans], dict[str, int], list[LeftOut]]:
    """Walks of all recordings, how many recordings were refused for each reason, and those that cannot be read."""
    walks: list[WalkMeans] = []
    refused: dict[str, int] = {}
    unreadable: list[LeftOut] = []
    paths = [(folder, path) for folder in sorted(gait.glob("*/*/")) for path in sorted(folder.rglob("*.c3d"))]
    trials = [(folder, path) for folder, path in paths if not any(path.match(pattern) for pattern in STATICS)]
    for k, (folder, path) in enumerate(trials):
        tell(0.9 * k / len(trials), f"walk {k + 1} of {len(trials)}")
        try:
            walks.append(walk_means(fit_walk(RecordedWalk.from_file(path, folder)), folder.parent.name))
        except StridelabError as error:
            refused[error.code] = refused.get(error.code, 0) + 1
            if isinstance(error, UnreadableFile):
                unreadable.append(LeftOut(f"{path.parent.name}/{path.name}", error.message))
    return walks, refused, unreadable


def walk_means(fitted: FittedWalk, laboratory: str) -> WalkMeans:
    """Means over the steps of a walk.

    Raises ``NotEstimable``: ``no-whole-step``, ``no-stature``, ``not-straight`` if the heading changes by more than
    15 degrees, ``no-double-support`` for a run.
    """
    if not fitted.fits:
        raise NotEstimable("no-whole-step", "The recording has no whole step.")
    if fitted.height_m is None:
        raise NotEstimable("no-stature", "The recording does not state the height of the person.")
    if not all(fit.step.strike_s < fit.step.next_lift_off_s for fit in fitted.fits):
        raise NotEstimable("no-double-support", "A step has no double support.")
    estimate = fitted.estimate
    start_s, end_s = fitted.fits[0].step.start_s, fitted.fits[-1].step.end_s
    inside = (estimate.time_s >= start_s) & (estimate.time_s <= end_s)
    v = estimate.velocity_m_s[inside, :2]
    half = len(v) // 2
    first, last = v[:half].mean(axis=0), v[half:].mean(axis=0)
    turn_rad = abs(np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last))
    if turn_rad > MAX_TURN_RAD:
        raise NotEstimable("not-straight", f"The heading changes by {np.degrees(turn_rad):.0f} degrees.")
    return WalkMeans(
        laboratory,
        fitted.person,
        fitted.height_m,
        float(v.mean(axis=0) @ fitted.ahead[:2]),
        {letter: float(np.mean([getattr(fit.path.wheel, f"{letter}_m") for fit in fitted.fits])) for letter in LETTERS},
    )


def fit_hierarchy(walks: Sequence[WalkMeans], letter: str, seed: int = 0) -> Hierarchy:
    """Fit the model, refit it on people drawn with replacement, and draw sixteen people from each refit.

    Raises ``NotEstimable`` as ``fit_mixed_model`` (too few people or repeats), and ``no-adults`` without three adults.
    """
    numbers: dict[tuple[str, str], list[WalkMeans]] = {}
    for walk in walks:
        numbers.setdefault((walk.laboratory, walk.person), []).append(walk)
    groups = list(numbers.values())
    adults = [group for group in groups if group[0].height_m >= ADULT_M]
    if len(adults) < 3:
        raise NotEstimable("no-adults", f"Three adults are needed, {len(adults)} have a walk.")
    model = _fit_model(groups, letter)
    rng = np.random.default_rng(seed)
    laboratories = sorted({lab for lab, _ in numbers})
    members = [[k for k, (lab, _) in enumerate(numbers) if lab == laboratory] for laboratory in laboratories]
    refits: list[tuple[float, float, float, float]] = []
    predicted: list[Series] = []
    while len(refits) < DRAWS:
        drawn = [groups[k] for of in members for k in rng.choice(of, len(of))]
        try:
            refit = _fit_model(drawn, letter)
        except NotEstimable:
            continue
        own_speed = [group[0] for group in drawn if group[0].height_m >= ADULT_M]
        if len({walk.person for walk in own_speed}) < 3:
            continue
        b, c = refit.effect("height").value, refit.effect("froude").value
        refits.append((b, c, refit.subject_sd, refit.step_sd))
        predicted.append(_predicted_coefficients(*refits[-1], [walk.froude_number for walk in own_speed], rng))
    return Hierarchy(letter, model, np.array(refits), np.array(predicted))


def _fit_model(groups: Sequence[Sequence[WalkMeans]], letter: str) -> MixedModel:
    """The model of log R, or log r, one list of walks per person."""
    rows = [(k, walk) for k, group in enumerate(groups) for walk in group]
    of = [walk for _, walk in rows]
    effects = {
        "height": np.log([walk.height_m / REFERENCE_M for walk in of]),
        "froude": np.log([walk.froude_number for walk in of]),
    }
    for laboratory in sorted({walk.laboratory for walk in of})[1:]:
        effects[laboratory] = np.array([float(walk.laboratory == laboratory) for walk in of])
    y = np.log([walk.values_m[letter] for walk in of])
    return fit_mixed_model(y, effects, np.array([k for k, _ in rows]))


def _predicted_coefficients(
    b: float, c: float, tau: float, sigma: float, froude: Sequence[float], rng: np.random.Generator
) -> Series:
    """Correlations with the height among sixteen people of the thesis' statures, at Froude numbers of our adults."""
    h = np.hstack([rng.normal(mean, sd, (PREDICTIONS, n)) for n, mean, sd in GROUPS])
    noise = rng.normal(0.0, np.hypot(tau, sigma / np.sqrt(TRIALS)), h.shape)
    value = np.exp(b * np.log(h / REFERENCE_M) + c * np.log(rng.choice(np.asarray(froude), h.shape)) + noise)
    x, y = (of - of.mean(axis=1, keepdims=True) for of in (h, value))
    return np.asarray((x * y).sum(axis=1) / np.sqrt((x**2).sum(axis=1) * (y**2).sum(axis=1)))


def _claims(hierarchy: Hierarchy, walks: Sequence[WalkMeans], n: int) -> list[Claim]:
    """The thesis' words, and its number."""
    letter = hierarchy.letter
    printed = THESIS_R[f"{letter}_m"]
    low, high = np.percentile(hierarchy.predicted_r, (2.5, 97.5)).tolist()
    froude, (least, most) = hierarchy.model.effect("froude"), hierarchy.exponent_interval(1)
    return [
        Measured(
            f"{letter}_exponent", "correlated", hierarchy.model.effect("height").value, "1", above(0.0, "words")
        ).says(
            f"{letter} is correlated to the size of the subjects, at equal Froude number",
            f"Exponent b of the height at equal Froude number, in {letter} ~ h^b Fr^c; bodies that move alike have 1. "
            f"c = {froude.value:.2f} [{least:.2f}, {most:.2f}].",
            n=n,
            interval=hierarchy.exponent_interval(0),
            where="figure 3.7",
        ),
        Measured(
            f"{letter}_coefficient", printed, hierarchy.two_sided_probability, "1", at_least(UNLIKELY, "ours")
        ).says(
            f"{letter}: a coefficient of {printed:g} among sixteen people",
            f"Two-sided probability of the printed coefficient by the model; 95 % of the coefficients lie from "
            f"{low:.2f} to {high:.2f}, their median is {float(np.median(hierarchy.predicted_r)):.2f}. Its interval is "
            f"that of {len(hierarchy.refits)} refits.",
            n=len({(walk.laboratory, walk.person) for walk in walks}),
            interval=hierarchy.probability_interval,
            where="figure 3.7",
        ),
    ]


def _effects_table(hierarchies: Sequence[Hierarchy]) -> dict[str, Column]:
    """Exponents with intervals, and standard deviations between people and between their walks (of the logarithm)."""
    return {
        "parameter": np.array([each.letter for each in hierarchies]),
        "height": np.array([each.model.effect("height").value for each in hierarchies]),
        "height_low": np.array([each.exponent_interval(0)[0] for each in hierarchies]),
        "height_high": np.array([each.exponent_interval(0)[1] for each in hierarchies]),
        "froude": np.array([each.model.effect("froude").value for each in hierarchies]),
        "froude_low": np.array([each.exponent_interval(1)[0] for each in hierarchies]),
        "froude_high": np.array([each.exponent_interval(1)[1] for each in hierarchies]),
        "between_people": np.array([each.model.subject_sd for each in hierarchies]),
        "between_walks": np.array([each.model.step_sd for each in hierarchies]),
    }


def _laboratory_table(walks: Sequence[WalkMeans]) -> dict[str, Column]:
    """People, walks and ranges of each laboratory."""
    names = sorted({walk.laboratory for walk in walks})
    of = [[walk for walk in walks if walk.laboratory == name] for name in names]
    return {
        "laboratory": np.array(names),
        "people": np.array([len({walk.person for walk in each}) for each in of]),
        "walks": np.array([len(each) for each in of]),
        "shortest_m": np.array([min(walk.height_m for walk in each) for each in of]),
        "tallest_m": np.array([max(walk.height_m for walk in each) for each in of]),
        "slowest_m_s": np.array([min(walk.speed_m_s for walk in each) for each in of]),
        "fastest_m_s": np.array([max(walk.speed_m_s for walk in each) for each in of]),
    }


def _refused_table(refused: Mapping[str, int]) -> dict[str, Column]:
    """Recordings that are not in the model, by reason."""
    return {"reason": np.array(list(refused), dtype=str), "recordings": np.array(list(refused.values()), dtype=int)}


def _walk_table(walks: Sequence[WalkMeans]) -> dict[str, Column]:
    """What the model is fitted to, people numbered."""
    people = sorted({(walk.laboratory, walk.person) for walk in walks})
    return {
        "laboratory": np.array([walk.laboratory for walk in walks]),
        "person": np.array([people.index((walk.laboratory, walk.person)) + 1 for walk in walks]),
        "height_m": np.array([walk.height_m for walk in walks]),
        "speed_m_s": np.array([walk.speed_m_s for walk in walks]),
        **{f"{letter}_m": np.array([walk.values_m[letter] for walk in walks]) for letter in LETTERS},
    }


def _panels(walks: Sequence[WalkMeans], hierarchies: Sequence[Hierarchy]) -> list[Panel]:
    """Each parameter against the height, and the distribution of the predicted coefficients."""
    laboratories = sorted({walk.laboratory for walk in walks})
    heights = [
        Panel(
            f"{letter} against the height",
            "height (m)",
            "m",
            [
                _spots([walk for walk in walks if walk.laboratory == name], letter, name, k)
                for k, name in enumerate(laboratories)
            ],
        )
        for letter in LETTERS
    ]
    coefficients = Panel(
        "Coefficients of sixteen people that the model predicts",
        "coefficient",
        "share of the draws below, 1",
        [
            Curve(
                np.quantile(each.predicted_r, SHARES),
                SHARES,
                f"{each.letter}, thesis {THESIS_R[each.letter + '_m']:g}",
                k,
            )
            for k, each in enumerate(hierarchies)
        ],
    )
    return [*heights, coefficients]


def _spots(walks: Sequence[WalkMeans], letter: str, name: str, colour: int) -> Curve:
    """A short upright stroke for each walk."""
    x = np.array([walk.height_m for walk in walks])
    y = np.array([walk.values_m[letter] for walk in walks])
    gap = np.full_like(x, np.nan)
    return Curve(
        np.column_stack([x, x, gap]).ravel(),
        np.column_stack([y - SPOT * y, y + SPOT * y, gap]).ravel(),
        name,
        colour,
    )
