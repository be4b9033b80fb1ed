"""RMS errors of all estimators per axis, and targets as ratios of horizontal errors; extends figure 2.7."""

from collections.abc import Sequence
from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Measured, Reproduction, at_least, reproduces, target
from stridelab.reproduction.common.estimator_errors import (
    GAITS,
    Draw,
    compute_draws,
    error_table,
    horizontal_ratio,
    rms,
    select_columns,
)
from stridelab.reproduction.common.estimators import AUTO, GEOMETRY, KALMAN, NAMES, RTS, SMOOTHER, THESIS
from stridelab.reproduction.common.intervals import resampled_interval
from stridelab.reproduction.report.svg_plots import Bars, render_svg

NOISES: Final = ("thesis", "white")
_SHOWN_COLUMNS: Final = (
    "gait",
    "noise",
    "estimator",
    "rms_x_m",
    "rms_y_m",
    "rms_z_m",
    "horizontal_m",
    "horizontal_worst_m",
)


@reproduces("errors", "RMS error of every estimator", draws="many", default_seeds=2, printed=("errors",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Both gaits, the thesis' noise and white noise, one draw per seed of each."""
    all_draws = compute_draws(GAITS, NOISES, seeds, lambda fraction, message: tell(0.98 * fraction, message))
    return Reproduction(
        claims=tuple(claim for gait in GAITS for claim in _gait_claims(gait, [d for d in all_draws if d.gait == gait])),
        note=f"{len(seeds)} draws per gait and noise; RMS along the walk (x), lateral (y) and vertical (z). The Kalman "
        "filter and the smoother are given the size of the noise; no estimator is given the error of the body model. "
        "The height is not observable: z is the geometry's with less noise. Part of the advantage of the thesis' "
        "filter over the Kalman filter comes from forward and backward filtering.",
        tables={"errors": select_columns(error_table(all_draws), _SHOWN_COLUMNS, lambda _: True)},
        drawing=render_svg(*(_error_bars(gait, noise, all_draws) for noise in NOISES for gait in GAITS)),
        references=("carpentier2017thesis", "carpentier2016spectral", "stasse2017talos"),
    )


def _gait_claims(gait: str, draws_of_gait: Sequence[Draw]) -> list[Claim]:
    by_noise = {noise: [d for d in draws_of_gait if d.noise == noise] for noise in NOISES}

    def ratio_claim(key: str, says: str, at_most: float, noise: str, one: str, other: str, note: str = "") -> Claim:
        drawn = by_noise[noise]
        return target(f"{gait}_{key}", horizontal_ratio(drawn, one, other), "1", at_most=at_most).says(
            f"{gait} gait, {noise} noise: {says}",
            note,
            interval=resampled_interval(
                lambda chosen: horizontal_ratio([drawn[k] for k in chosen], one, other), len(drawn)
            ),
            comparator=other,
        )

    def smallest_bias(chosen: Sequence[int]) -> float:
        """Smallest RMS of the constant vertical error over the geometry's, draws of both noises."""
        drawn = [of[k] for of in by_noise.values() for k in chosen]
        bias = {name: rms([float(d.errors[name].mean_m[2]) for d in drawn]) for name in NAMES}
        return min(bias.values()) / bias[GEOMETRY]

    n = len(by_noise["thesis"])
    height = smallest_bias(range(n))
    return [
        ratio_claim("smoother_over_filter", "the smoother over the thesis' filter", 0.15, "thesis", SMOOTHER, THESIS),
        ratio_claim(
            "smoother_over_kalman", "the smoother over the thesis' Kalman filter", 0.07, "thesis", SMOOTHER, KALMAN
        ),
        ratio_claim(
            "white_smoother_over_filter", "the smoother over the thesis' filter", 0.35, "white", SMOOTHER, THESIS
        ),
        ratio_claim(
            "filter_over_kalman",
            "the thesis' filter, forward and backward, over its Kalman filter",
            0.6,
            "thesis",
            THESIS,
            KALMAN,
            f"RTS smoother with the Kalman filter's model and a realistic jerk: "
            f"{horizontal_ratio(by_noise['thesis'], RTS, KALMAN):.2f}; it also filters in both directions.",
        ),
        ratio_claim(
            "auto_over_thesis", "default over thesis' cut-offs (1.5 times better)", 1 / 1.5, "thesis", AUTO, THESIS
        ),
        Measured(f"{gait}_best_height", "unlikely", height, "1", at_least(0.8, "ours")).says(
            f"{gait} gait: the height is not observable (smallest constant error of z over the geometry's)",
            "Estimators reduce the configuration noise in z, but not the bias of the segment table.",
            interval=resampled_interval(smallest_bias, n),
            comparator=GEOMETRY,
        ),
    ]


def _error_bars(gait: str, noise: str, all_draws: Sequence[Draw]) -> Bars:
    group = [d for d in all_draws if (d.gait, d.noise) == (gait, noise)]
    return Bars(
        f"Horizontal RMS error, {gait} gait, {noise} noise",
        "mm",
        [(name, 1e3 * rms([d.errors[name].horizontal_m for d in group])) for name in NAMES],
    )
