"""Figure 3.10: start and end of double support predicted by the cycloid model."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Reproduction, reproduces, target
from stridelab.reproduction.common.simulated_steps import NOTE, SimulatedSteps, simulated_steps
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg
from stridelab.walking.double_support import double_support_of_wheel
from stridelab.walking.path_fit import fit_path
from stridelab.walking.step_fit import StepFit

MAX_HEIGHT_M: Final = 0.004
"""Largest distance of the CoM from the hub's height at a crossing: that of the path from its wheel."""


@reproduces("fig-3.10", "Double support from the crossings of the hub's height", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """One simulated walk."""
    tell(0.05, "simulating a walk")
    steps = simulated_steps(seeds[0])
    tell(0.9, "fitting")
    fits = steps.fits[:-1]
    whole = np.array([_prediction_errors_s(steps, fit) for fit in fits])
    heights_m = [_height_at_crossings_m(steps, fit, errors) for fit, errors in zip(fits, whole, strict=True)]
    pairs = np.isfinite(whole).all(axis=1)
    inside = sum(fit.double_support_model_s[1] is not None for fit in fits)
    double_s = np.array([np.diff(fit.step.double_support_s)[0] for fit in fits])
    enclosed = float(np.nanmean((double_s + whole[:, 1] - whole[:, 0]) / double_s))
    start, end = np.nanmean(whole, axis=0).tolist()
    claims = (
        target("crossing_height_m", max(heights_m), "m", at_most=MAX_HEIGHT_M).says(
            "simulated walker: height of the CoM at both crossings minus that of the hub (largest)",
            f"The step itself contains the second crossing in {inside} of {len(fits)} steps, so that both are searched "
            "over single, double and single support.",
            cases_inside=sum(height_m <= MAX_HEIGHT_M for height_m in heights_m),
        ),
        target("double_pair", float(pairs.mean()), "1", at_least=1.0).says(
            "simulated walker: share of the steps with both crossings",
            f"Predicted minus planned: {1e3 * start:+.0f} ms (start) and {1e3 * end:+.0f} ms (end); the crossings "
            f"enclose {enclosed:.1f} double supports, because with uniform rotation the point is below the hub for "
            "half of every step. The height is a cosine by construction: people are in fig-3.10-people.",
            cases_inside=int(pairs.sum()),
        ),
    )
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={
            "crossings": {
                "strike_s": np.array([fit.step.strike_s for fit in steps.fits[:-1]]),
                "start_error_s": whole[:, 0],
                "end_error_s": whole[:, 1],
            }
        },
        drawing=render_svg(*_draw_panels(steps, whole)),
        n=len(whole),
    )


def _prediction_errors_s(steps: SimulatedSteps, fit: StepFit) -> tuple[float, float]:
    """Errors of both predictions; NaN if there is no crossing even including the single support after the step."""
    samples, step = steps.step_and_next_support(fit), fit.step
    t = steps.recorded.truth.time_s[samples]
    wheel = fit_path(t, steps.path_m[samples], step.period_s)
    start, end = double_support_of_wheel(wheel, t, near_s=(step.strike_s + step.next_lift_off_s) / 2)
    return (
        float("nan") if start is None else start - step.strike_s,
        float("nan") if end is None else end - step.next_lift_off_s,
    )


def _height_at_crossings_m(steps: SimulatedSteps, fit: StepFit, errors_s: np.ndarray) -> float:
    """Largest distance of the CoM from the height of the hub at both predicted instants."""
    samples = steps.step_and_next_support(fit)
    t, path_m = steps.recorded.truth.time_s[samples], steps.path_m[samples]
    hub_m = fit_path(t, path_m, fit.step.period_s).wheel.z0_m
    heights_m = np.interp(np.array(fit.step.double_support_s) + errors_s, t, path_m[:, 1])
    return float(np.abs(heights_m - hub_m).max())


def _draw_panels(steps: SimulatedSteps, whole: np.ndarray) -> list[Panel | Bars]:
    fit = steps.fits[0]
    samples = steps.step_and_next_support(fit)
    t, z = steps.recorded.truth.time_s[samples], steps.path_m[samples, 1]
    hub = fit_path(t, steps.path_m[samples], fit.step.period_s).wheel.z0_m
    instants = [
        Curve(np.array([at, at]), np.array([z.min(), z.max()]), name, 2, dashed=True)
        for at, name in zip(fit.step.double_support_s, ("double support", "ends"), strict=True)
    ]
    return [
        Bars(
            "Crossing minus instant, mean of the steps",
            "ms",
            [("beginning", 1e3 * float(whole[:, 0].mean())), ("end", 1e3 * float(whole[:, 1].mean()))],
        ),
        Panel(
            "Height of the centre of mass and of the hub",
            "time (s)",
            "height (m)",
            [Curve(t, z, "centre of mass", 0), Curve(t, np.full_like(t, hub), "hub", 1), *instants],
        ),
    ]
