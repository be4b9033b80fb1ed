"""Chapter 3 on people: all steps of adults at a comfortable (C4) and a fast speed (C5), Schreiber and Moissenet 2019.

The simulated walker of the other items is no witness for these claims: its height is a cosine per step, and the
variation between its steps is a parameter. One trial per person and speed has two steps; one of them is partly beside
the plates, where the smoother extends its estimate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Progress, Series
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.reproduction.chapter3.numbers import MIN_SUBJECT_SHARE, pendulum_rise_m
from stridelab.reproduction.claims import Claim, Measured, Reproduction, met_if
from stridelab.reproduction.common.recorded_walks import RecordedWalk, recordings_in
from stridelab.reproduction.common.simulated_people import parameter_values
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.walking.population.population import Pair, Person, StepRow, study
from stridelab.walking.step_fit import StepFit, fit_steps
from stridelab.walking.steps import find_steps

NAME: Final = "wheel-people"
TITLE: Final = "The rolling wheel, real recordings"
PRINTED: Final[tuple[str, ...]] = ("speeds",)
SPEEDS: Final[Mapping[str, str]] = {
    "comfortable": "rehazenter-adult-walking/*/*_C4_*.c3d",
    "fast": "rehazenter-adult-walking/*/*_C5_*.c3d",
}
HEIGHT_R: Final = (("R_m", "R", 0.67), ("r_m", "r", 0.61), ("z0_m", "z0", 0.87))
"""Printed correlations with the height (figures 3.7 and 3.8)."""
THESIS_OMEGA_P: Final = 0.83
FEW_MS_S: Final = 0.01
GOOD_CLOCK_M: Final = 0.0035
Range = tuple[float, float]


@dataclass(frozen=True, eq=False)
class FittedWalk:
    """All fitted steps of one person at one speed."""

    person: str
    height_m: float | None
    fits: tuple[StepFit, ...]

    def spread_m(self, name: str) -> float:
        """Standard deviation of a parameter of the wheel between the steps; NaN for one step."""
        values = [getattr(fit.path.wheel, name) for fit in self.fits]
        return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")

    def distance_mm(self, *, measured: bool) -> Range:
        """Mean and standard deviation of the distance within a step, means of the steps; ``measured``: on plates."""
        chosen = [fit.path.distance_m for fit in self.fits if fit.step.measured or not measured]
        return (1e3 * float(np.mean([d.mean() for d in chosen])), 1e3 * float(np.mean([d.std() for d in chosen])))


def run(gait: Path, tell: Progress) -> Reproduction:
    """All adults below the folder ``gait``. Raises ``NotFound`` (``recordings-missing``) if there are none."""
    walks: dict[str, list[FittedWalk]] = {}
    for k, (speed, pattern) in enumerate(SPEEDS.items()):
        tell(k / len(SPEEDS), speed)
        walks[speed] = [fit_walk(RecordedWalk.from_file(path)) for path in recordings_in(gait, pattern)]
    tell(1.0, "done")
    everyone = [walk for of_speed in walks.values() for walk in of_speed]
    fits = [fit for walk in everyone for fit in walk.fits]
    return Reproduction(
        claims=(*_distance_claims(walks), *_spread_claims(walks), *_height_claims(everyone), *_model_claims(fits)),
        note=f"{len(walks['comfortable'])} adults at a comfortable and {len(walks['fast'])} at a fast speed, "
        f"{len(fits)} steps; the smoother's centre of mass with the latency corrected and the person's static trial. "
        "Per person there are two steps at each speed, one of them partly beside the plates: the deviation between "
        "steps contains the error of the estimate there.",
        tables={"speeds": _speed_table(walks)},
        drawing=render_svg(
            *(
                Bars(
                    f"Mean distance between path and wheel, {speed}",
                    "mm",
                    [(f"adult {k + 1}", walk.distance_mm(measured=False)[0]) for k, walk in enumerate(of_speed)],
                )
                for speed, of_speed in walks.items()
            )
        ),
    ).with_basis("people", len(walks["comfortable"]))


def fit_walk(walk: RecordedWalk) -> FittedWalk:
    """Estimate the centre of mass, also beside the plates, and fit the wheel to all whole steps."""
    latency = estimate_latency(walk.geometric, walk.total_wrench, walk.mass_kg)
    latency_s = latency.latency_s if latency.significant else 0.0
    estimate = Smoother(beyond_window=True).estimate(walk.geometric, walk.total_wrench(latency_s), walk.mass_kg)
    landmarks = identify(list(walk.recording.markers_m)).landmarks
    steps = find_steps(walk.recording, landmarks, walk.windows, latency_s=latency_s)
    ahead = walk.recording.walking_direction
    fits = fit_steps(estimate, steps, walk_frame(estimate.velocity_m_s)[0] if ahead is None else ahead, walk.windows)
    return FittedWalk(walk.person, walk.recording.subject.height_m, fits)


def _distance_claims(walks: Mapping[str, Sequence[FittedWalk]]) -> list[Claim]:
    """Claims of 3.3.1 and figure 3.6."""
    good = {
        (speed, measured): [mean < 1.0 and sd < 0.5 for mean, sd in (w.distance_mm(measured=measured) for w in of)]
        for speed, of in walks.items()
        for measured in (True, False)
    }
    counts = {key: f"{sum(values)} of {len(values)}" for key, values in good.items()}
    share = float(np.mean(good["comfortable", True]))
    claims = [
        Measured("below_1_mm", "numerous", share, "1", met_if(share >= MIN_SUBJECT_SHARE)).says(
            "for numerous subjects the mean is below 1 mm and the deviation below 0.5 mm (3.3.1)",
            f"{counts['comfortable', True]} adults at a comfortable speed, steps with all force on plates; with all "
            f"steps {counts['comfortable', False]}; at a fast speed {counts['fast', True]} and "
            f"{counts['fast', False]}. A quarter counts as numerous.",
        )
    ]
    for speed, of_speed in walks.items():
        mean, sd = np.max([walk.distance_mm(measured=False) for walk in of_speed], axis=0).tolist()
        claims += [
            Measured(f"{speed}_mean_mm", 3.5, mean, "mm", met_if(mean <= 3.5)).says(
                f"{speed} speed: the mean distance of all subjects remains below 3.5 mm (figure 3.6)",
                "The largest mean of a person, all steps.",
                n=len(of_speed),
            ),
            Measured(f"{speed}_sd_mm", 1.5, sd, "mm", met_if(sd <= 1.5)).says(
                f"{speed} speed: with a maximal standard deviation of 1.5 mm (figure 3.6)",
                "The largest standard deviation of a person, all steps.",
                n=len(of_speed),
            ),
        ]
    return claims


def _spread_claims(walks: Mapping[str, Sequence[FittedWalk]]) -> list[Claim]:
    """Claims of the captions of figures 3.7 and 3.8 on the variation from step to step."""

    def largest_m(name: str) -> float:
        return float(np.nanmax([walk.spread_m(name) for of in walks.values() for walk in of]))

    def counts(name: str, below_m: float) -> str:
        parts = []
        for speed, of_speed in walks.items():
            spreads = np.array([walk.spread_m(name) for walk in of_speed])
            known = spreads[np.isfinite(spreads)]
            parts.append(f"{(known < below_m).sum()} of {len(known)} ({speed})")
        return ", ".join(parts)

    radii_m, z0_m = max(largest_m("R_m"), largest_m("r_m")), largest_m("z0_m")
    n = sum(len(of_speed) for of_speed in walks.values())
    return [
        Measured("radii_sd_m", 0.005, radii_m, "m", met_if(radii_m <= 0.005)).says(
            "R and r vary by less than 5 mm from step to step (figure 3.7)",
            f"Largest standard deviation of a trial. Below 5 mm: R in {counts('R_m', 0.005)}; r in "
            f"{counts('r_m', 0.005)}.",
            n=n,
        ),
        Measured("z0_sd_m", 0.002, z0_m, "m", met_if(z0_m <= 0.002)).says(
            "z0 varies by less than 2 mm from step to step (figure 3.8)",
            f"Largest standard deviation of a trial. Below 2 mm in {counts('z0_m', 0.002)}.",
            n=n,
        ),
    ]


def _height_claims(walks: Sequence[FittedWalk]) -> list[Claim]:
    """Claims of figures 3.7 to 3.9: one mean per person over all steps at both speeds."""
    heights = {walk.person: walk.height_m for walk in walks}
    people = [Person(name=name, group="adults", height_m=height_m) for name, height_m in heights.items()]
    rows = [StepRow(walk.person, walk.person, parameter_values(fit)) for walk in walks for fit in walk.fits]
    pairs = {pair.parameter: pair for pair in study(people, rows).pairs if pair.against == "height_m"}
    return [
        *(_correlation_claim(pairs[parameter], letter, printed) for parameter, letter, printed in HEIGHT_R),
        _omega_claim(pairs["omega_rad_s"]),
    ]


def _correlation_claim(pair: Pair, letter: str, printed: float) -> Claim:
    """Met if the thesis' value lies in our 95 % interval, beaten if below it."""
    ours = pair.pearson
    low, high = ours.ci95 or (-1.0, 1.0)
    verdict = met_if(printed <= high)
    return Measured(f"{letter}_height_r", printed, ours.r, "1", "beaten" if printed < low else verdict).says(
        f"{letter} is correlated with the height of the subjects",
        f"One mean per person over all steps at both speeds, p = {ours.p:.2g}. Met if the printed value lies in our "
        "interval"
        + (", which also contains 0: this number of people decides nothing." if low < 0.0 <= printed <= high else "."),
        n=ours.n,
        interval=(low, high),
    )


def _omega_claim(pair: Pair) -> Claim:
    ours = pair.pearson
    low, high = ours.ci95 or (-1.0, 1.0)
    return Measured("omega_height_p", THESIS_OMEGA_P, ours.p, "1", met_if(ours.p >= THESIS_OMEGA_P)).says(
        "omega is hardly correlated with the height: p is 0.83 or more",
        f"r = {ours.r:.2f}, 95 % from {low:.2f} to {high:.2f}: a correlation is neither detected nor excluded, and a "
        "p of 0.83 would not exclude it.",
        n=ours.n,
    )


def _model_claims(fits: Sequence[StepFit]) -> list[Claim]:
    """Claims of 3.3.3 and 3.4.1: existing models, the even clock, double support."""
    wheel_m = float(np.mean([fit.path.distance_m.mean() for fit in fits]))
    pendulum_m = float(np.mean([pendulum_rise_m(fit) - np.ptp(fit.path_m[:, 1]) for fit in fits]))
    ratio = wheel_m / pendulum_m
    sinusoid = np.median([_rms_m(fit, "wheel") / _rms_m(fit, "sinusoid") for fit in fits])
    clock_m = float(np.mean([fit.timed.distance_m.mean() for fit in fits]))
    start_s, end_s = (_double_support_errors_s(fits, end) for end in (0, 1))
    return [
        Measured("over_pendulum", 0.1, ratio, "1", met_if(ratio <= 0.1)).says(
            "the level of error is one order of magnitude less than that of existing models (3.4.1)",
            f"Mean distance of the wheel over what a pendulum overestimates the vertical excursion by, "
            f"{1e3 * pendulum_m:.1f} mm. The existing models of 3.4.1 are pendula, wrong by up to 20 mm. A sinusoid "
            f"with the same number of parameters, which the thesis does not mention, is closer: the wheel has "
            f"{sinusoid:.2f} times its RMS error (median).",
            n=len(fits),
            comparator="inverted pendulum",
        ),
        Measured("even_clock_m", "good", clock_m, "m", met_if(clock_m <= GOOD_CLOCK_M)).says(
            "theta = theta_0 + omega t is a good approximation (3.4)",
            "Mean distance at the same times, with uniform rotation; good up to 3.5 mm, the thesis' error of the path.",
            n=len(fits),
        ),
        *(
            Measured(f"double_{name}_s", "few ms", float(np.mean(errors)), "s", met_if(_is_few_ms(errors))).says(
                f"the model predicts the {name} of double support to a few milliseconds (3.3.3)",
                f"Predicted minus measured, mean; RMS {1e3 * float(np.sqrt(np.mean(errors**2))):.0f} ms.",
                n=len(errors),
            )
            for name, errors in (("start", start_s), ("end", end_s))
            if len(errors)
        ),
    ]


def _is_few_ms(errors_s: Series) -> bool:
    return bool(np.sqrt(np.mean(errors_s**2)) <= FEW_MS_S)


def _double_support_errors_s(fits: Sequence[StepFit], end: int) -> Series:
    """Predicted minus measured start (0) or end (1) of double support where the wheel predicts one."""
    pairs = [(fit.double_support_model_s[end], fit.step.double_support_s[end]) for fit in fits]
    return np.array([model - measured for model, measured in pairs if model is not None])


def _rms_m(fit: StepFit, model: str) -> float:
    return next(score.rms_m for score in fit.path_rivals if score.model == model)


def _speed_table(walks: Mapping[str, Sequence[FittedWalk]]) -> dict[str, np.ndarray]:
    """One row per speed: means over the adults, so that no row is a person."""
    distances = {speed: [walk.distance_mm(measured=False)[0] for walk in of] for speed, of in walks.items()}
    return {
        "speed": np.array(list(walks)),
        "people": np.array([len(of) for of in walks.values()]),
        "steps": np.array([sum(len(walk.fits) for walk in of) for of in walks.values()]),
        "mean_distance_m": np.array([1e-3 * float(np.mean(distances[speed])) for speed in walks]),
        **{
            f"median_sd_of_{name}": np.array(
                [float(np.nanmedian([walk.spread_m(name) for walk in of])) for of in walks.values()]
            )
            for name in ("R_m", "r_m", "z0_m")
        },
    }
