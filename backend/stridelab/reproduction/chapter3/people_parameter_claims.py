"""Claims of figures 3.7 to 3.10 on the parameters of people's wheels: variation, height, speed, clock, crossings."""

from typing import Final

import numpy as np

from stridelab.reproduction.chapter3.people_path_claims import mean_claim
from stridelab.reproduction.chapter3.people_walks import SPEEDS, FittedWalk, Walks, pooled_spread
from stridelab.reproduction.claims import Claim, Measured, above, at_most, within
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.common.simulated_people import parameter_values
from stridelab.walking.population.correlations import MIN_SUBJECTS, fisher_interval
from stridelab.walking.population.population import Pair, Person, StepRow, study

FEW_MS_S: Final = 0.01
GOOD_CLOCK_M: Final = 0.0035
"""Mean distance up to which uniform rotation counts as good: the thesis' error of the path."""
RADIUS_SD_M, HUB_SD_M = 0.005, 0.002
"""Deviations from step to step in the captions of figures 3.7 and 3.8."""
THESIS_R: Final = {"R_m": 0.67, "r_m": 0.61, "z0_m": 0.87}
THESIS_PEOPLE: Final = 16
OMEGA_R: Final = 0.058
"""Correlation of 16 people whose p is 0.83 (figure 3.9): a weaker one has a larger p."""


def spread_claims(walks: Walks, name: str, letter: str, bound_m: float) -> list[Claim]:
    """Variation of a parameter from step to step, pooled over people: two steps give no deviation of a person."""
    claims = []
    for speed, of in walks.items():
        spreads_m = [walk.spread_m(name) for walk in of]
        if not np.isfinite(spreads_m).any():
            continue
        pooled_m, interval = pooled_spread(spreads_m)
        geometric_m, _ = pooled_spread([walk.geometric_spread_m(name) for walk in of])
        few = sum(spread_m <= bound_m for spread_m in spreads_m)
        claims.append(
            Measured(f"{speed}_{letter}_sd_m", bound_m, pooled_m, "m", at_most(bound_m, "thesis")).says(
                f"{speed} speed: the standard deviation of {letter} is below {1e3 * bound_m:g} mm for all the subjects",
                f"Pooled over people: if all are below {1e3 * bound_m:g} mm, the pool is. By their two steps alone "
                f"{few} of {len(of)} people are below; the largest has {1e3 * float(np.nanmax(spreads_m)):.1f} mm. By "
                f"the geometry alone, to which the end of the plates means nothing: {1e3 * geometric_m:.1f} mm.",
                n=len(of),
                interval=interval,
            )
        )
    return claims


def _height_pairs(walks: Walks) -> dict[str, Pair]:
    """Correlations with the height of one mean per person over all steps at both speeds; none of too few people."""
    everyone = [walk for of in walks.values() for walk in of]
    people = [
        Person(name=name, group="adults", height_m=height_m)
        for name, height_m in {walk.person: walk.height_m for walk in everyone}.items()
    ]
    rows = [StepRow(walk.person, walk.person, parameter_values(fit)) for walk in everyone for fit in walk.fits]
    return {pair.parameter: pair for pair in study(people, rows).pairs if pair.against == "height_m"}


def _height_claims(walks: Walks, *names: str) -> list[Claim]:
    """Correlation of each parameter with the height, if there are people enough for one."""
    pairs = _height_pairs(walks)
    return [correlation_claim(pairs[name], name.removesuffix("_m"), THESIS_R[name]) for name in names if name in pairs]


def missing_correlations_text(people: int) -> str:
    """Why figures 3.7 to 3.9 lack claims with few people, as a sentence that follows another one; empty otherwise."""
    if people >= MIN_SUBJECTS:
        return ""
    return f" A correlation with the height needs {MIN_SUBJECTS} people, there are {people}: its claims are missing."


def few_people_text(people: int) -> str:
    """Why nothing is decided with few people, as a sentence that follows another one; empty otherwise."""
    if people >= MIN_SUBJECTS:
        return ""
    return f" All claims are undecided: they are on subjects, of whom {MIN_SUBJECTS} are needed and {people} are here."


def correlation_claim(pair: Pair, letter: str, printed: float) -> Claim:
    """The claim holds above 0; an interval that contains 0 decides nothing."""
    ours = pair.pearson
    low, high = ours.ci95 or (-1.0, 1.0)
    inside = "in" if low <= printed <= high else "out of"
    least, most = fisher_interval(printed, THESIS_PEOPLE) or (-1.0, 1.0)
    return Measured(f"{letter}_height_r", printed, ours.r, "1", above(0.0, "words")).says(
        f"{letter} is correlated to the size of the subjects, by the coefficient",
        f"One mean per person over all steps at both speeds, p = {ours.p:.2g}. The printed value lies {inside} our "
        f"interval; its own, of {THESIS_PEOPLE} people, is {least:.2f} to {most:.2f}.",
        n=ours.n,
        interval=(low, high),
    )


def omega_claim(pair: Pair) -> Claim:
    """The claim holds for coefficients up to that which has p = 0.83 among 16 people."""
    ours = pair.pearson
    return Measured("omega_height_r", "p ≥ 0.83", ours.r, "1", within(-OMEGA_R, OMEGA_R, "thesis")).says(
        "the weak correlation (p ≥ 0.83) between the angular velocity and the size of the subjects",
        f"p = {ours.p:.2g}. Among the thesis' 16 people a p of 0.83 is a coefficient of {OMEGA_R:g}.",
        n=ours.n,
        interval=ours.ci95 or (-1.0, 1.0),
    )


def radius_claims(walks: Walks) -> list[Claim]:
    """Figure 3.7, and that the parameters depend on the height only."""
    return [
        *spread_claims(walks, "R_m", "R", RADIUS_SD_M),
        *spread_claims(walks, "r_m", "r", RADIUS_SD_M),
        *_height_claims(walks, "R_m", "r_m"),
        *(claim for name in ("R_m", "r_m") for claim in _speed_claims(walks, name, name[0], RADIUS_SD_M)),
    ]


def _speed_claims(walks: Walks, name: str, letter: str, bound_m: float) -> list[Claim]:
    """A parameter that depends on the height only is the same at both speeds of a person; none without such people."""
    means = {
        speed: {walk.person: walk.mean_of(lambda fit: float(getattr(fit.path.wheel, name))) for walk in of}
        for speed, of in walks.items()
    }
    slow, fast = means.get("comfortable", {}), means.get("fast", {})
    both = sorted(slow.keys() & fast.keys())
    if not both:
        return []
    changes_m = [fast[person] - slow[person] for person in both]
    numbers = Measured(
        f"{letter}_change_m", "only depends", float(np.mean(changes_m)), "m", within(-bound_m, bound_m, "ours")
    )
    return [
        numbers.says(
            f"{letter} only depends on the height of the subjects",
            f"Change of a person from the comfortable to the fast speed, mean. The bound is ours: the "
            f"{1e3 * bound_m:g} mm that the thesis calls low are a deviation between steps at one speed, and it has "
            "one speed per person.",
            n=len(both),
            interval=interval_of(changes_m),
            where="abstract of chapter 3",
        )
    ]


def hub_height_claims(walks: Walks) -> list[Claim]:
    """Figure 3.8."""
    return [
        *spread_claims(walks, "z0_m", "z0", HUB_SD_M),
        *_height_claims(walks, "z0_m"),
        *_speed_claims(walks, "z0_m", "z0", HUB_SD_M),
    ]


def clock_claims(walks: Walks) -> list[Claim]:
    """Figure 3.9."""
    return [
        *(
            claim
            for speed in SPEEDS
            for claim in mean_claim(
                walks, speed, "even_clock_m", "well", "m", at_most(GOOD_CLOCK_M, "ours"),
                lambda walk: walk.mean_of(lambda fit: float(fit.timed.distance_m.mean())),
                "theta can be well approximated by an affine function of time (3.4)",
                "Mean distance at the same times, with uniform rotation; good up to the thesis' error of the path.",
            )
        ),
        *(omega_claim(pair) for name, pair in _height_pairs(walks).items() if name == "omega_rad_s"),
    ]  # fmt: skip


def double_support_claims(walks: Walks) -> list[Claim]:
    """Figure 3.10 and 3.3.3."""
    claims = []
    for speed, of in walks.items():
        rows = np.array([row for walk in of for row in walk.double_support_errors_s()])
        known = rows[np.isfinite(rows).all(axis=1)] if len(rows) else rows
        if not len(known):
            continue
        for column, name in enumerate(("start", "end")):
            errors_s = known[:, column]
            claims.append(
                Measured(
                    f"{speed}_{name}_s", "few ms", float(errors_s.mean()), "s", within(-FEW_MS_S, FEW_MS_S, "ours")
                ).says(
                    f"{speed} speed: the {name} of double support is captured with only few milliseconds of errors",
                    f"Predicted minus measured, mean; both crossings exist in {len(known)} of {len(rows)} steps.",
                    n=len(known),
                    interval=interval_of(errors_s),
                )
            )
        enclosed = (known[:, 2] + known[:, 1] - known[:, 0]) / known[:, 2]
        claims.append(
            Measured(f"{speed}_enclosed", 1.0, float(enclosed.mean()), "1", within(0.9, 1.1, "ours")).says(
                f"{speed} speed: the crossings approximatively match the start and end of the double support phase",
                "Time between the crossings over the duration of double support.",
                n=len(known),
                interval=interval_of(enclosed),
                where="3.3.3",
            )
        )
    return claims


def start_error_ms(walk: FittedWalk) -> float:
    """Predicted minus measured start of double support, mean of the steps; NaN without a prediction."""
    errors_s = [start_s for start_s, _, _ in walk.double_support_errors_s()]
    return 1e3 * float(np.mean(errors_s)) if errors_s else float("nan")
