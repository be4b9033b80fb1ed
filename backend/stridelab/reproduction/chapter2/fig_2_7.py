"""Figure 2.7: complementary filter compared with the Kalman filter of 2.5.3, and contribution of each input."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.estimation.complementary.contributions import split_contributions
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.evaluation.truth_errors import error_m
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, above, at_least, reproduces
from stridelab.reproduction.common.estimator_errors import (
    GAITS,
    Draw,
    compute_draws,
    error_table,
    rms,
)
from stridelab.reproduction.common.estimators import GEOMETRY, KALMAN, SMOOTHER, THESIS, study_estimators
from stridelab.reproduction.common.intervals import resampled_interval
from stridelab.reproduction.common.own_aims import as_own_aim
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.reproduction.studies.estimator_study import StudyTrial, simulate_trial

DRAWN_ESTIMATORS: Final = (THESIS, KALMAN, SMOOTHER)
_PARTS: Final = ("geometry", "force", "axis", "total")


@reproduces("fig-2.7", "Complementary filter against Kalman filter", draws="many", default_seeds=2)
def run(seeds: range, tell: Progress) -> Reproduction:
    """Both gaits with the thesis' noise, one draw per seed of each."""
    all_draws = compute_draws(GAITS, ("thesis",), seeds, lambda fraction, message: tell(0.95 * fraction, message))
    claims = [_thesis_or_aim(c) for gait in GAITS for c in _gait_claims(gait, [d for d in all_draws if d.gait == gait])]
    tell(0.95, "drawing")
    trial = simulate_trial("robot", "thesis", seeds[0])
    tracks, parts = _trajectory_columns(trial), _contribution_columns(trial)
    return Reproduction(
        claims=tuple(claims),
        note=f"{len(seeds)} draws per gait. The thesis plots one walk of a robot: what is said of a human gait, "
        "or of all trials, is an aim of ours. The filter is not better at every sample. Part of its advantage comes "
        "from forward and backward filtering: the Rauch-Tung-Striebel smoother with the Kalman filter's model is as "
        "accurate. The errors of all estimators are in the item errors.",
        tables={"errors": error_table(all_draws), "tracks": tracks, "contributions": parts},
        drawing=render_svg(*_draw_panels(tracks, parts)),
        references=("carpentier2017thesis", "carpentier2016spectral", "stasse2017talos"),
    )


def _thesis_or_aim(claim: Claim) -> Claim:
    """The thesis shows one walk of a robot: claims on human gait and on all trials are ours."""
    is_of_thesis = claim.key.startswith("robot_") and not claim.key.endswith("trials_not_worse")
    return claim if is_of_thesis else as_own_aim(claim)


def _gait_claims(gait: str, thesis: Sequence[Draw]) -> list[Claim]:
    not_worse = [d.errors[THESIS].horizontal_m <= d.errors[KALMAN].horizontal_m for d in thesis]

    def share_not_worse(chosen: Sequence[int]) -> float:
        return float(np.mean([thesis[k].share_closer for k in chosen]))

    def height_over_geometry(chosen: Sequence[int]) -> float:
        ours, base = ([thesis[k].errors[name].vertical_m for k in chosen] for name in (THESIS, GEOMETRY))
        return rms(ours) / rms(base)

    def noise_over_kalman(chosen: Sequence[int]) -> float:
        ours, base = ([thesis[k].noisy_m[name] for k in chosen] for name in (THESIS, KALMAN))
        return rms(ours) / rms(base)

    n = len(thesis)
    return [
        Measured(
            f"{gait}_trials_not_worse",
            1.0,
            float(np.mean(not_worse)),
            "1",
            at_least(1.0, "ours"),
        ).says(
            f"{gait} gait: the filter is never worse than the Kalman filter (trials, horizontal RMS)",
            cases_inside=sum(not_worse),
            comparator=KALMAN,
        ),
        Measured(
            f"{gait}_samples_not_worse",
            1.0,
            share_not_worse(range(n)),
            "1",
            at_least(1.0, "words"),
        ).says(
            f"{gait} gait: its error is always inferior or equivalent (samples, horizontal)",
            "Share of the samples at which the filter is no farther from the truth, without a tolerance.",
            interval=resampled_interval(share_not_worse, n),
            comparator=KALMAN,
        ),
        Measured(
            f"{gait}_height_over_geometry", "biased", height_over_geometry(range(n)), "1", above(0.5, "ours")
        ).says(
            f"{gait} gait: the height is biased",
            "RMS vertical error over that of the geometry.",
            interval=resampled_interval(height_over_geometry, n),
            comparator=GEOMETRY,
        ),
        Measured(
            f"{gait}_noise_over_kalman",
            "more",
            noise_over_kalman(range(n)),
            "1",
            above(1.0, "words"),
        ).says(
            f"{gait} gait: the filter has more high-frequency noise than the Kalman filter",
            "Horizontal RMS of the error above 5 Hz, over the Kalman filter's.",
            interval=resampled_interval(noise_over_kalman, n),
            comparator=KALMAN,
        ),
    ]


def _trajectory_columns(trial: StudyTrial) -> dict[str, Column]:
    """True and estimated trajectories of one trial with their errors."""
    columns = {"time_s": trial.truth.time_s} | _axis_columns("truth_{}_m", trial.truth.com_m)
    all_estimators = study_estimators(trial)
    for name in DRAWN_ESTIMATORS:
        estimate = all_estimators[name].estimate(trial.geometric, trial.wrench, trial.mass_kg)
        key = name.replace("-", "_")
        columns |= _axis_columns(f"{key}_{{}}_m", estimate.com_m)
        columns |= _axis_columns(f"error_{key}_{{}}_m", error_m(estimate, trial.truth.time_s, trial.truth.com_m))
    return columns


def _contribution_columns(trial: StudyTrial) -> dict[str, Column]:
    signals = ComplementaryFilter.thesis().input_signals(trial.geometric, trial.wrench, trial.mass_kg)
    parts = split_contributions(signals.filters, signals.inputs)
    columns = {"time_s": trial.truth.time_s}
    for name in _PARTS:
        columns |= _axis_columns(f"{name}_{{}}_m", getattr(parts, f"{name}_m"))
    return columns


def _axis_columns(pattern: str, track: np.ndarray) -> dict[str, Column]:
    return {pattern.format(axis): track[:, k] for k, axis in enumerate("xyz")}


def _draw_panels(tracks: dict[str, Column], parts: dict[str, Column]) -> list[Panel]:
    t, key = tracks["time_s"], THESIS.replace("-", "_")
    path = [
        Curve(t, tracks[f"{source}_{axis}_m"], f"{axis}, {name}", k, source == "truth")
        for source, name in (("truth", "true"), (key, "filter"))
        for k, axis in enumerate("xyz")
    ]
    shares = [
        Panel(
            f"Contributions, {axis}",
            "time (s)",
            "position (m)",
            [Curve(t, parts[f"{part}_{axis}_m"], part, k, part == "total") for k, part in enumerate(_PARTS)],
        )
        for axis in "xz"
    ]
    errors = [
        Panel(
            f"Error, {axis}",
            "time (s)",
            "error (mm)",
            [
                Curve(t, 1e3 * tracks[f"error_{name.replace('-', '_')}_{axis}_m"], name, k)
                for k, name in enumerate(DRAWN_ESTIMATORS)
            ],
        )
        for axis in "xyz"
    ]
    return [Panel("Reconstructed trajectory", "time (s)", "position (m)", path), *shares, *errors]
