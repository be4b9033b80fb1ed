"""Numbers in the text of chapter 2: ranks, offset of the central axis, perfect inputs, forward and backward passes.

The figures have their own items: filters in 2.5, spectra in 2.6, errors in 2.7, bias and delay in 2.8 and 2.9, the
Kalman filter's delay in the item lag.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Points, Progress, g
from stridelab.dynamics.wrench import Wrench, central_axis
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.complementary.forward_backward import forward_pass, initial_state
from stridelab.estimation.evaluation.error_spectra import error_spectrum
from stridelab.estimation.kalman.filter import KalmanFilter
from stridelab.estimation.observability import (
    STATES,
    STATES_WITH_BIAS,
    force_and_geometry_matrix,
    force_matrix,
)
from stridelab.reproduction.claims import (
    DETERMINISTIC,
    Claim,
    Measured,
    Reproduction,
    at_least,
    at_most,
    below,
    reproduces,
    within,
)
from stridelab.reproduction.common.estimator_errors import GAITS, rms
from stridelab.reproduction.common.intervals import resampled_interval
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg
from stridelab.reproduction.studies.estimator_study import StudyTrial, simulate_trial
from stridelab.simulation.robot.walker import RATE_HZ

TOLERANCE: Final = 1e-9
"""Tolerance of a rank, in the units of the matrices (position in units of g times one second squared)."""
SEVERAL_CENTIMETRES_M: Final = 0.02
"""Minimum that counts as "several centimetres"."""
GOOD_MASS_SHARE: Final = 0.005
"""Relative error of the mass up to which an estimate counts as good."""
SEGMENT_S: Final = 8.0
RANK_SAMPLE_STEP: Final = 10
"""Sampling interval of the rank computation."""


@reproduces("numbers-2", "Numbers in the text of chapter 2", draws="many", default_seeds=3)
def run(seeds: range, tell: Progress) -> Reproduction:
    """One walk per gait without noise, and one draw per seed with the thesis' noise."""
    clean = {gait: simulate_trial(gait, "none", 0) for gait in GAITS}
    tell(0.2, "ranks")
    claims = list(_rank_claims(clean["robot"]))
    offset = {gait: _axis_offset_m(trial) for gait, trial in clean.items()}
    for gait in GAITS:
        tell(0.4, f"{gait} gait")
        claims += _axis_claims(gait, clean[gait], offset[gait])
        noisy = [simulate_trial(gait, "thesis", seed) for seed in seeds]
        claims += _noise_claims(gait, clean[gait], noisy)
    time_s = {gait: trial.truth.time_s for gait, trial in clean.items()}
    return Reproduction(
        claims=tuple(claims),
        note=f"TALOS walks at its own and at a human cadence; {len(seeds)} draws of the noise of 2.5.1 where noise is "
        "used. Ranks are computed along the walk without noise.",
        tables={
            f"axis_{gait}": {"time_s": time_s[gait]} | {f"off_{a}_m": offset[gait][:, k] for k, a in enumerate("xyz")}
            for gait in GAITS
        },
        drawing=render_svg(
            *(
                Panel(
                    f"Central axis minus centre of mass, {gait} gait",
                    "time (s)",
                    "distance (mm)",
                    [Curve(time_s[gait], 1e3 * offset[gait][:, k], a, k) for k, a in enumerate("xyz")],
                )
                for gait in GAITS
            ),
            Bars(
                "Largest distance of the centre of mass from the axis",
                "mm",
                [(gait, 1e3 * float(np.linalg.norm(offset[gait], axis=1).max())) for gait in GAITS],
            ),
        ),
        references=("carpentier2017thesis", "carpentier2016spectral", "stasse2017talos"),
    )


def _rank_claims(trial: StudyTrial) -> tuple[Claim, ...]:
    """Ranks of (2.19) and (2.23) at every tenth sample, and of (2.19) in free fall."""
    truth = trial.truth
    at = slice(None, None, RANK_SAMPLE_STEP)
    c, v, a = truth.com_m, truth.velocity_m_s, truth.acceleration_m_s2
    rank, both = (
        np.linalg.matrix_rank(matrix(c[at], v[at], a[at]), tol=TOLERANCE)
        for matrix in (force_matrix, force_and_geometry_matrix)
    )
    falling = int(np.linalg.matrix_rank(force_matrix(np.zeros(3), np.zeros(3), np.asarray(g)), tol=TOLERANCE))
    return (
        _rank_claim(
            "rank_force", f"(2.19): 7 of {STATES} states are observable from force and moment", 7, rank, "2.3.1"
        ),
        _rank_claim(
            "rank_both", f"(2.23): with the geometry, 11 of {STATES_WITH_BIAS} states are observable", 11, both, "2.3.2"
        ),
        _rank_claim(
            "rank_falling", "in free fall only the acceleration is observable", 3, np.array([falling]), "2.3.1"
        ),
    )


def _rank_claim(key: str, says: str, thesis: int, ranks: np.ndarray, where: str) -> Claim:
    worst = int(ranks[np.argmax(np.abs(ranks - thesis))])
    return Measured(
        key,
        float(thesis),
        float(worst),
        "1",
        within(float(thesis), float(thesis), "thesis", otherwise="thesis_in_error"),
    ).says(
        says,
        f"The same in all {len(ranks)} states." if len(ranks) > 1 and np.ptp(ranks) == 0 else "",
        **DETERMINISTIC,
        where=where,
    )


def _axis_offset_m(trial: StudyTrial) -> Points:
    """c_p - c of (2.12) with perfect sensors and a perfect model, i.e. due to L' alone; shape (n, 3)."""
    axis = central_axis(Wrench(trial.wrench.force_n, trial.wrench.moment_nm))
    return np.asarray(axis.project(trial.truth.com_m) - trial.truth.com_m)


def _axis_claims(gait: str, trial: StudyTrial, off_m: Points) -> tuple[Claim, ...]:
    """2.3.3: distance of the axis from the CoM due to L', and share of L' below the stride frequency."""
    largest = float(np.linalg.norm(off_m, axis=1).max())
    stride_hz = 0.5 / trial.step_time_s
    spectrum = error_spectrum(trial.truth.momentum_rate_nm, RATE_HZ, SEGMENT_S)
    low_power, total_power = (spectrum.band_rms(0.0, top) for top in (stride_hz - spectrum.resolution_hz, RATE_HZ))
    share = float((low_power**2).sum() / (total_power**2).sum())
    return (
        Measured(f"{gait}_off_axis_m", "several cm", largest, "m", at_least(SEVERAL_CENTIMETRES_M, "ours")).says(
            f"{gait} gait: gesticulation separates CoM and central axis by up to several centimetres",
            "Largest distance of the walk, without noise and model error. It grows with the square of the cadence.",
            **DETERMINISTIC,
            where="2.3.3",
        ),
        Measured(f"{gait}_slow_gesticulation", "almost none", share, "1", at_most(0.01, "ours")).says(
            f"{gait} gait: below half of the stepping frequency there is almost no gesticulation",
            f"Share of the power of L' below {stride_hz:.2f} Hz. The mean offset of the axis from the CoM is "
            f"nevertheless {1e3 * float(np.linalg.norm(off_m.mean(axis=0))):.1f} mm, because force and L' are "
            "correlated.",
            **DETERMINISTIC,
            where="2.3.3",
        ),
    )


def _noise_claims(gait: str, clean: StudyTrial, noisy: list[StudyTrial]) -> tuple[Claim, ...]:
    """2.4: perfect inputs; 2.5.1: mass; 2.5.3: jerk; 2.6.3: forward and backward pass."""
    truth = clean.truth
    through_com = replace(clean.wrench, moment_nm=np.cross(truth.com_m, clean.wrench.force_n))
    fused = ComplementaryFilter.thesis().estimate(clean.geometric, through_com, clean.mass_kg)
    perfect = float(np.abs(fused.com_m - truth.com_m).max())
    weighed = [float(t.wrench.force_n[:, 2].mean()) / (GRAVITY_M_S2 * t.mass_kg) - 1.0 for t in noisy]
    mass = float(np.abs(weighed).max())
    exact = int((np.abs(weighed) <= GOOD_MASS_SHARE).sum())
    jerk = np.gradient(truth.acceleration_m_s2, truth.time_s, axis=0)
    jerk_rms = float(np.sqrt(np.mean(jerk**2, axis=0)).max())
    passes_m = [_passes_m(trial) for trial in noisy]

    def both_over_one(chosen: Sequence[int]) -> float:
        both, one = (rms([passes_m[draw][k] for draw in chosen]) for k in (0, 1))
        return both / one

    sigma = KalmanFilter().sigma_jerk_m_s3
    return (
        Measured(f"{gait}_perfect_m", 0.0, perfect, "m", at_most(1e-5, "words")).says(
            f"{gait} gait: with perfect measurements the filter gives the exact value, without latency",
            "Largest error over all samples and coordinates, with the central axis through the CoM.",
            **DETERMINISTIC,
            where="2.4",
        ),
        Measured(f"{gait}_mass", "good", mass, "1", at_most(GOOD_MASS_SHARE, "ours")).says(
            f"{gait} gait: the mean vertical force gives a good estimate of the mass",
            "Largest relative error, over a walk that begins and ends at rest, with the noise of 2.5.1.",
            cases_inside=exact,
            where="2.5.1",
        ),
        Measured(f"{gait}_jerk", sigma, jerk_rms, "m/s³", at_most(2.0 * sigma, "ours")).says(
            f"{gait} gait: with a jerk of 1 m/s³ the Kalman filter trusts the measurements",
            "RMS of the jerk of the motion along the axis with the largest jerk: a filter that expects less jerk "
            "trusts its prediction and is delayed (item lag). The thesis speaks of the gain of its filter, on a robot.",
            **DETERMINISTIC,
            where="2.5.3",
        ),
        Measured(f"{gait}_both_passes", "< 1", both_over_one(range(len(noisy))), "1", below(1.0, "words")).says(
            f"{gait} gait: an average of a forward and a backward pass increases the precision",
            "Horizontal RMS error of the average over that of the forward pass alone.",
            interval=resampled_interval(both_over_one, len(noisy)),
            where="2.6.3",
        ),
    )


def _passes_m(trial: StudyTrial) -> tuple[float, float]:
    """Horizontal RMS errors of the thesis' filter and of its forward pass alone."""
    thesis = ComplementaryFilter.thesis()
    fused = thesis.estimate(trial.geometric, trial.wrench, trial.mass_kg)
    signals = thesis.input_signals(trial.geometric, trial.wrench, trial.mass_kg)
    one_pass_m = forward_pass(signals.filters, signals.inputs, initial_state(signals.filters, signals.inputs))
    both, one = (
        float(np.sqrt(np.mean(((track - trial.truth.com_m)[:, :2] ** 2).sum(axis=1))))
        for track in (fused.com_m, one_pass_m[signals.stretch.within])
    )
    return both, one
