"""Running: vertical acceleration of every estimate in flight phases compared with g, since only gravity acts."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.errors import NotEstimable
from stridelab.estimation.evaluation.physics_residuals import assess_flight
from stridelab.estimation.evaluation.truth_errors import truth_error
from stridelab.reproduction.claims import Claim, Reproduction, reproduces, target
from stridelab.reproduction.common.accepted_draws import accept_draws
from stridelab.reproduction.common.estimator_errors import as_columns, rms
from stridelab.reproduction.common.estimators import NAMES, SMOOTHER, study_estimators
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.report.svg_plots import Bars, render_svg
from stridelab.reproduction.studies.estimator_study import simulate_trial

NOISES: Final = ("marker-like", "thesis")
MAX_GRAVITY_ERROR_SHARE: Final = 0.02


@reproduces("flight", "Free fall in running", draws="many", default_seeds=2, printed=("flight",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Running with marker and plate noise and with the thesis' noise, one draw per seed of each."""
    rows: list[dict[str, object]] = []
    claims: list[Claim] = []
    notes: list[str] = []
    for k, noise in enumerate(NOISES):

        def tell_draw(fraction: float, message: str, k: int = k, noise: str = noise) -> None:
            tell((k + fraction) / len(NOISES), f"{noise} noise, {message}")

        draws = accept_draws(seeds, partial(_flights_of_draw, noise), tell_draw)
        flown = list(draws.results.values())
        shares = {name: [each[name].share for each in flown] for name in NAMES}
        errors = {name: [each[name].error_m for each in flown] for name in NAMES}
        notes += [f" With {noise} noise:{draws.describe_refused()}"] if draws.describe_refused() else []
        rows += [
            {
                "noise": noise,
                "estimator": name,
                "vertical_share": rms([s for s, _ in shares[name]]),
                "vertical_share_worst": float(np.abs([s for s, _ in shares[name]]).max()),
                "horizontal_m_s2": rms([a for _, a in shares[name]]),
                "horizontal_m": rms([h for h, _ in errors[name]]),
                "vertical_m": rms([v for _, v in errors[name]]),
            }
            for name in NAMES
        ]
        claims.append(_smoother_claim(noise, [share for share, _ in shares[SMOOTHER]]))
    return Reproduction(
        claims=tuple(claims),
        note=f"{len(seeds)} draws each of a run at about 1 m/s with flight phases of 0.11 s; vertical acceleration "
        "over g, minus one, from a parabola fitted to the heights of a flight phase. The best "
        f"published values are 1.1 to 3.1 %.{''.join(notes)}",
        tables={"flight": as_columns(rows)},
        drawing=render_svg(
            *(
                Bars(
                    f"Relative error of the vertical acceleration in flight (RMS), {noise} noise",
                    "%",
                    [
                        (str(row["estimator"]), 100.0 * float(str(row["vertical_share"])))
                        for row in rows
                        if row["noise"] == noise
                    ],
                )
                for noise in NOISES
            )
        ),
        references=("carpentier2017thesis", "stasse2017talos"),
    )


@dataclass(frozen=True)
class _Flight:
    """Of one estimator: vertical acceleration over g minus one, horizontal acceleration, and errors along both."""

    share: tuple[float, float]
    error_m: tuple[float, float]


def _flights_of_draw(noise: str, seed: int) -> dict[str, _Flight]:
    """All estimators on one run; raises ``NotEstimable`` (``no-flight``) if the flight phases are too short."""
    trial = simulate_trial("running", noise, seed)
    flown = {}
    for name, estimator in study_estimators(trial).items():
        estimate = estimator.estimate(trial.geometric, trial.wrench, trial.mass_kg)
        aloft = assess_flight(estimate, trial.wrench)
        if aloft is None:
            raise NotEstimable("no-flight", "The run has no flight phase long enough to estimate a curvature.")
        error = truth_error(estimate, trial.truth.time_s, trial.truth.com_m)
        flown[name] = _Flight((aloft.vertical_share, aloft.horizontal_m_s2), (error.horizontal_m, error.vertical_m))
    return flown


def _smoother_claim(noise: str, shares: Sequence[float]) -> Claim:
    """``shares``: relative error of the vertical acceleration in flight, one per draw."""
    return target(f"{noise}_smoother", rms(shares), "1", at_most=MAX_GRAVITY_ERROR_SHARE).says(
        f"{noise} noise: vertical acceleration of the smoother in flight equals g (RMS over the draws)",
        f"Worst draw {100 * float(np.abs(shares).max()):.2f} %.",
        n=len(shares),
        interval=interval_of(shares, lambda chosen: rms(chosen.tolist())),
    )
