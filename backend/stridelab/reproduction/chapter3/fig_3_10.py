"""Figure 3.10: start and end of double support predicted by the cycloid model."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Measured, Reproduction, met_if, reproduces
from stridelab.reproduction.common.simulated_steps import NOTE, SimulatedSteps, simulated_steps
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg
from stridelab.walking.double_support import double_support_of_wheel
from stridelab.walking.path_fit import fit_path
from stridelab.walking.step_fit import StepFit

MAX_ERROR_S: Final = 0.01
"""Maximum that counts as "only few milliseconds"."""


@reproduces("fig-3.10", "Double support from the crossings of the hub's height", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """One simulated walk."""
    tell(0.05, "simulating a walk")
    steps = simulated_steps(seeds[0])
    tell(0.9, "fitting")
    whole = np.array([_prediction_errors_s(steps, fit) for fit in steps.fits[:-1]])
    inside = sum(fit.double_support_model_s[1] is not None for fit in steps.fits)
    double_s = np.array([np.diff(fit.step.double_support_s)[0] for fit in steps.fits[:-1]])
    enclosed = float(np.mean((double_s + whole[:, 1] - whole[:, 0]) / double_s))
    start, end = whole.mean(axis=0).tolist()
    claims = (
        _few_milliseconds_claim(
            "start_s",
            "the model predicts the start of double support to a few milliseconds",
            start,
            "Predicted minus planned; both crossings of the hub's height are searched over single, double and single "
            f"support, because the step itself contains the second crossing in only {inside} of {len(steps.fits)} "
            "steps.",
        ),
        _few_milliseconds_claim(
            "end_s", "the model predicts its end to a few milliseconds", end, "Predicted minus planned."
        ),
        Measured("enclosed_over_double_support", 1.0, enclosed, "1", met_if(abs(enclosed - 1.0) < 0.1)).says(
            "the crossings enclose the double support",
            "Time between the crossings over the duration of double support. With uniform rotation the point is below "
            "the hub for half of every step, but double support is only a fifth of it.",
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


def _few_milliseconds_claim(key: str, says: str, off_s: float, note: str) -> Claim:
    return Measured(key, "few ms", off_s, "s", met_if(abs(off_s) <= MAX_ERROR_S)).says(says, note)


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
