"""Claims of figures 3.3 to 3.6 and of sections 3.2 and 3.4 on the path of the centre of mass of people."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.reproduction.chapter3.numbers import MEASURED_MM, MIN_SUBJECT_SHARE, pendulum_rise_m, speed_variations
from stridelab.reproduction.chapter3.people_walks import SPEEDS, FittedWalk, Walks, path_of
from stridelab.reproduction.claims import (
    Basis,
    Claim,
    Criterion,
    Measured,
    above,
    at_least,
    at_most,
    below,
    target,
    within,
)
from stridelab.reproduction.common.intervals import interval_of, resampled_interval
from stridelab.reproduction.common.own_aims import as_own_aim
from stridelab.walking.step_fit import StepFit

SLIGHT_SHARE: Final = 0.1
"""Relative difference of two successive steps that counts as slight."""
SIMILAR_SHARE: Final = 0.1
"""Mean distance over the vertical excursion that counts as very similar."""
EVENT_S: Final = 0.015
PENDULUM_M: Final = 0.02
MAX_MEAN_MM, MAX_SD_MM = 3.5, 1.5
"""Largest mean and standard deviation of the distance of a subject (caption of figure 3.6)."""


def mean_claim(
    walks: Walks, speed: str, key: str, thesis: float | str, unit: str, holds: Criterion,
    value: Callable[[FittedWalk], float], words: str, note: str = "", where: str = "", comparator: str | None = None,
) -> list[Claim]:  # fmt: skip
    """Claim on the mean of one number per person at one speed, with its interval; none if no person has the number."""
    values = [number for number in map(value, walks.get(speed, ())) if np.isfinite(number)]
    if not values:
        return []
    numbers = Measured(f"{speed}_{key}", thesis, float(np.mean(values)), unit, holds)
    basis: Basis = {"n": len(values), "interval": interval_of(values), "where": where, "comparator": comparator}
    return [numbers.says(f"{speed} speed: {words}", note, **basis)]


def shape_claims(walks: Walks) -> list[Claim]:
    """Figure 3.3 and 3.2.5."""
    claims = [
        claim
        for speed in SPEEDS
        for claim in mean_claim(
            walks, speed, "distance_over_rise", "very similar", "1", at_most(SIMILAR_SHARE, "ours"),
            lambda walk: walk.mean_of(lambda fit: float(fit.path.distance_m.mean() / np.ptp(fit.path_m[:, 1]))),
            "its shape is very similar to the curtate cycloid", "Mean distance over the vertical excursion, all steps.",
        )
    ]  # fmt: skip
    ratios: dict[str, float] = {}
    for walk in (walk for of in walks.values() for walk in of):
        of_walk = max(fit.path.wheel.r_m / fit.path.wheel.R_m for fit in walk.fits)
        ratios[walk.person] = max(of_walk, ratios.get(walk.person, 0.0))
    claims.append(
        Measured("r_over_R", "curtate", max(ratios.values()), "1", below(1.0, "words")).says(
            "the path is a curtate cycloid: r below R",
            "Largest ratio of all steps at both speeds.",
            cases_inside=sum(ratio < 1.0 for ratio in ratios.values()),
        )
    )
    claims += [
        claim
        for speed in SPEEDS
        for claim in mean_claim(
            walks, speed, "convex_share", "longer", "1", above(0.5, "words"), FittedWalk.convex_share,
            "the convex lower part of the cycle is longer than the concave higher part",
            "Share of the length of a step on which the plates carry more than the weight; no model of the path.",
            "3.2.5",
        )
    ]  # fmt: skip
    return claims


def segmentation_claims(walks: Walks) -> list[Claim]:
    """Figure 3.4, 3.2.6 and 3.2.7."""
    of_person: dict[str, list[float]] = {}
    for walk in (walk for of in walks.values() for walk in of):
        of_person.setdefault(walk.person, []).extend(walk.event_differences_s())
    differences_s = [d for of in of_person.values() for d in of]
    people = list(of_person.values())

    def rms_s(chosen: Sequence[int]) -> float:
        return float(np.sqrt(np.mean(np.square([d for k in chosen for d in people[k]]))))

    claims = [
        target("events_s", rms_s(range(len(people))), "s", at_most=EVENT_S).says(
            "strikes and lift-offs from plates and markers against the laboratory's own events (RMS)",
            f"Mean {1e3 * float(np.mean(differences_s)):+.0f} ms: ours are corrected for the latency of the force. "
            f"About it they scatter by {1e3 * float(np.std(differences_s)):.0f} ms, not a common clock. The "
            "laboratory's events are no truth. Interval: people drawn with replacement.",
            n=len(differences_s),
            interval=resampled_interval(rms_s, len(people)),
            comparator="events of the files",
        )
    ]
    for speed in SPEEDS:
        claims += [
            *mean_claim(
                walks, speed, "amplitude_change", "slightly", "1", at_most(SLIGHT_SHARE, "ours"),
                lambda walk: _relative_change(walk, lambda fit: float(np.ptp(fit.path_m[:, 1]))),
                "the amplitude of the CoM trajectory varies slightly between two consecutive steps",
                "Absolute difference of the vertical excursion over its mean.", "3.2.7",
            ),
            *mean_claim(
                walks, speed, "duration_change", "slightly", "1", at_most(SLIGHT_SHARE, "ours"),
                lambda walk: _relative_change(walk, lambda fit: fit.step.end_s - fit.step.start_s),
                "the cycle duration varies slightly between two consecutive steps",
                "Absolute difference of the time from lift-off to lift-off over its mean.", "3.2.7",
            ),
            *mean_claim(
                walks, speed, "finer", "finer", "1", below(1.0, "words"),
                lambda walk: 1e-3 * walk.distance_mm(measured=False)[0] / walk.height_variability_m(),
                "fitting one step reaches precisions finer than the intra-subject variability",
                "Mean distance over the variability of the height between the steps of a person.", "3.2.7",
                "variability between steps",
            ),
        ]  # fmt: skip
    return claims


def _relative_change(walk: FittedWalk, value: Callable[[StepFit], float]) -> float:
    """Mean absolute difference of successive steps over the mean of the steps."""
    values = np.array([value(fit) for fit in walk.fits])
    return float(np.abs(np.diff(values)).mean() / values.mean()) if len(values) > 1 else float("nan")


def largest_error_m(walk: FittedWalk) -> float:
    """Largest distance within the measured steps."""
    return max(float(fit.path.distance_m.max()) for fit in walk.fits if fit.step.measured)


def _up_over_ahead(walk: FittedWalk) -> float:
    ahead, up = (np.sqrt(np.mean([np.mean(fit.path.error_m[:, k] ** 2) for fit in walk.fits])) for k in (0, 1))
    return float(up / ahead)


def one_step_claims(walks: Walks) -> list[Claim]:
    """Figure 3.5."""
    claims: list[Claim] = []
    for speed, of in walks.items():
        largest_m, up = [largest_error_m(walk) for walk in of], [_up_over_ahead(walk) for walk in of]
        few = sum(value <= 0.0015 for value in largest_m)
        claims += [
            Measured(f"{speed}_largest_m", 0.0015, float(np.median(largest_m)), "m", at_most(0.0015, "thesis")).says(
                f"{speed} speed: over the whole cycle, the reconstruction error remains below 1.5 mm",
                f"Largest error within a step with all force on plates, median person; below 1.5 mm in {few} of "
                f"{len(of)}. The thesis shows one person, and adds that this does not vary a lot among subjects.",
                n=len(of),
                interval=interval_of(largest_m, np.median),
            ),
            Measured(f"{speed}_up", "mainly", min(up), "1", above(1.0, "words")).says(
                f"{speed} speed: it is mainly contained in the vertical direction",
                "RMS error up over that ahead, smallest of all people.",
                n=len(of),
                cases_inside=sum(ratio > 1.0 for ratio in up),
            ),
        ]
    return claims


def fitted_curve_claims(walks: Walks) -> list[Claim]:
    """Figure 3.5 and 3.3.1."""
    return [*one_step_claims(walks), *asymmetry_claims(walks)]


def asymmetry_claims(walks: Walks) -> list[Claim]:
    """3.3.1: the fitted curve is as asymmetric as the path, which the plates say without a model of the path."""
    claims = []
    for speed, of in walks.items():
        shares = np.array([(walk.curve_convex_share(), walk.convex_share()) for walk in of])
        of_curve, measured = shares[np.isfinite(shares).all(axis=1)].T
        if not len(measured):
            continue

        def over_symmetric(chosen: Sequence[int], curve: Series = of_curve, plates: Series = measured) -> float:
            missed, there = curve[list(chosen)] - plates[list(chosen)], plates[list(chosen)] - 0.5
            return float(np.sqrt(np.mean(missed**2) / np.mean(there**2)))

        n = len(measured)
        claims.append(
            Measured(
                f"{speed}_asymmetry", "reproduces", over_symmetric(range(n)), "1", below(1.0, "words")
            ).says(
                f"{speed} speed: the fitting is able to reproduce its asymmetry",
                "RMS difference of the convex shares of the length, of the curve and of the step by the plates, over "
                "that of a symmetric curve (a half). Means of the shares: "
                f"{of_curve.mean():.3f} and {measured.mean():.3f}. Interval: people drawn with replacement.",
                n=n,
                interval=resampled_interval(over_symmetric, n),
                comparator="a symmetric curve",
                where="3.3.1",
            )
        )  # fmt: skip
    return claims


def distance_claims(walks: Walks) -> list[Claim]:
    """Figure 3.6 and 3.3.1."""
    good = {
        (speed, measured): [mean < 1.0 and sd < 0.5 for mean, sd in (w.distance_mm(measured=measured) for w in of)]
        for speed, of in walks.items()
        for measured in (True, False)
    }
    counts = [
        f"{sum(values)} of {len(values)} at a {speed} speed with {'all force on plates' if measured else 'all steps'}"
        for (speed, measured), values in good.items()
    ]
    claims = []
    if "comfortable" in walks:
        share = float(np.mean(good["comfortable", True]))
        claims.append(
            Measured("below_1_mm", "numerous", share, "1", at_least(MIN_SUBJECT_SHARE, "ours")).says(
                "for numerous subjects the mean error is less than 1 mm with very low standard deviation, less than "
                "0.5 mm",
                f"{', '.join(counts)}. A quarter counts as numerous.",
                interval=interval_of(np.array(good["comfortable", True], dtype=float)),
                where="3.3.1",
            )
        )
    for speed, of in walks.items():
        distances_mm = np.array([walk.distance_mm(measured=False) for walk in of])
        mean, sd = distances_mm.max(axis=0).tolist()
        near, even = (distances_mm <= [MAX_MEAN_MM, MAX_SD_MM]).sum(axis=0).tolist()
        claims += [
            Measured(f"{speed}_mean_mm", MAX_MEAN_MM, mean, "mm", at_most(MAX_MEAN_MM, "thesis")).says(
                f"{speed} speed: the mean reconstruction for all the subjects remains below 3.5 mm",
                "The largest mean of a person, all steps.",
                n=len(of),
                cases_inside=near,
            ),
            Measured(f"{speed}_sd_mm", MAX_SD_MM, sd, "mm", at_most(MAX_SD_MM, "thesis")).says(
                f"{speed} speed: with a maximal standard deviation of 1.5 mm",
                "The largest standard deviation of a person, all steps. The text of 3.3.1 has 1 mm.",
                n=len(of),
                cases_inside=even,
            ),
        ]
    return claims


def text_claims(walks: Walks) -> list[Claim]:
    """3.4.1 and 3.4.5."""
    fits = [fit for of in walks.values() for walk in of for fit in walk.fits]
    people = sorted({walk.person for of in walks.values() for walk in of})
    of_person = [[fit for of in walks.values() for walk in of if walk.person == name for fit in walk.fits]
                 for name in people]  # fmt: skip
    wheels_m = [[float(fit.path.distance_m.mean()) for fit in own] for own in of_person]
    excesses_m = [[pendulum_rise_m(fit) - float(np.ptp(fit.path_m[:, 1])) for fit in own] for own in of_person]

    def over_pendulum(chosen: Sequence[int]) -> float:
        wheel_m, over_m = ([value for k in chosen for value in values[k]] for values in (wheels_m, excesses_m))
        return float(np.mean(wheel_m) / np.mean(over_m))

    def pendulum_over_m(chosen: Sequence[int]) -> float:
        return float(np.median([value for k in chosen for value in excesses_m[k]]))

    every, n = range(len(people)), len(people)
    sinusoid = float(np.median([_rms_m(fit, "wheel") / _rms_m(fit, "sinusoid") for fit in fits]))
    claims = [
        Measured("over_pendulum", 0.1, over_pendulum(every), "1", at_most(0.1, "thesis")).says(
            "the level of error is one order of magnitude less than the existing models in the literature",
            "Mean distance of the wheel over what a pendulum overestimates the vertical excursion by. A sinusoid with "
            "the same number of parameters, which the thesis does not mention, is closer: the wheel has "
            f"{sinusoid:.2f} times its RMS error (median).",
            comparator="inverted pendulum",
            interval=resampled_interval(over_pendulum, n),
            where="3.4.1",
        ),
        Measured("pendulum_over_m", PENDULUM_M, pendulum_over_m(every), "m", within(0.01, 0.04, "ours")).says(
            "existing models overestimate the vertical position by up to 2 cm",
            "Vertical excursion of a pendulum as long as the CoM is high, minus that of the CoM; median step.",
            interval=resampled_interval(pendulum_over_m, n),
            where="3.4.1",
        ),
        *mean_claim(
            walks, "comfortable", "distance_mm", MEASURED_MM, "mm", at_most(MEASURED_MM, "thesis"),
            lambda walk: walk.distance_mm(measured=False)[0],
            "the model fits with a higher precision than the accuracy of the measurement systems, around 2 mm",
            "Mean distance of a person, all steps.", "3.4.1",
        ),
    ]  # fmt: skip
    for speed in SPEEDS:
        claims += [
            *mean_claim(
                walks, speed, "curve_variability", "comparable", "1", within(0.5, 2.0, "ours"),
                lambda walk: walk.curve_variability_m() / walk.height_variability_m(),
                "the parameters of a subject follow a tight distribution which spans a space comparable to the "
                "variability of the gait itself",
                "Difference of the heights of successive curves over that of the steps.", "3.4.3",
                "variability between steps",
            ),
            *map(as_own_aim, mean_claim(
                walks, speed, "prediction", "reliable", "1", at_most(1.0, "ours"),
                lambda walk: walk.prediction_error_m() / walk.height_variability_m(),
                "the curve of one step predicts the next as well as the step itself does",
                "Difference of the height of a step and the curve of the step beside it, over that of both steps. "
                "3.4.3 calls the model a reliable predictor, without a number.",
                comparator="the step beside it, as measured",
            )),
            *mean_claim(
                walks, speed, "orbit", "constant", "1", at_most(0.1, "ours"), _orbit_variation,
                "in the frame of the hub the CoM orbits at a constant distance from the origin",
                "Standard deviation of the distance over its mean.", "3.4.5",
            ),
            *mean_claim(
                walks, speed, "hub_over_com", "low-varying", "1", at_most(1.0, "ours"),
                lambda walk: walk.mean_of(lambda fit: float(np.divide(*speed_variations(fit)))),
                "the centre of the wheel hovers at low-varying velocity",
                "Variation of its speed within a step over that of the CoM; low if no larger.", "3.4.5",
            ),
        ]  # fmt: skip
    return claims


def _orbit_variation(walk: FittedWalk) -> float:
    def step_variation(fit: StepFit) -> float:
        distance_m = np.hypot(*path_of(fit).T)
        return float(distance_m.std() / distance_m.mean())

    return walk.mean_of(step_variation)


def _rms_m(fit: StepFit, model: str) -> float:
    return next(score.rms_m for score in fit.path_rivals if score.model == model)
