"""Figure 3.5: centre of mass of one step, fitted curtate cycloid and residual."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Reproduction, reproduces, target
from stridelab.reproduction.common.intervals import interval_of, resampled_interval
from stridelab.reproduction.common.simulated_steps import NOTE, simulated_steps
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.walking.step_fit import StepFit

MEAN_M: Final = 0.0035


@reproduces("fig-3.5", "One step and the wheel through it", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """One simulated walk."""
    tell(0.05, "simulating a walk")
    fits = simulated_steps(seeds[0]).fits
    tell(0.9, "fitting")
    worst = max(float(f.path.distance_m.max()) for f in fits)
    free_m, even_m = (
        np.array([float(of.distance_m.mean()) for of in each])
        for each in ([f.path for f in fits], [f.timed for f in fits])
    )
    ahead, up = (float(np.sqrt(np.mean([np.mean(f.path.error_m[:, k] ** 2) for f in fits]))) for k in (0, 1))
    other = float(np.mean([f.reversed_timed.distance_m.mean() for f in fits]))
    excess = float(np.mean([_excess_m_s(f) for f in fits]))
    rolled = float(np.mean([f.path.wheel.r_m * f.omega_rad_s for f in fits]))
    claims = (
        target("mean_distance_m", float(free_m.mean()), "m", at_most=MEAN_M).says(
            "simulated walker: mean distance of the wheel with free angles",
            f"{len(fits)} steps; the largest error of a sample is {1e3 * worst:.1f} mm, at the end of double support, "
            f"and the error is {up / ahead:.1f} times larger up than ahead.",
            interval=interval_of(free_m),
        ),
        target("free_below_even", float(free_m.mean() / even_m.mean()), "1", at_most=1.0).says(
            "simulated walker: the wheel with free angles over the wheel with uniform rotation, mean distance",
            f"Uniform rotation: {1e3 * even_m.mean():.1f} mm, the cycloid with the opposite sign {1e3 * other:.1f} mm. "
            f"At the lowest point the cycloid is {rolled:.2f} m/s slower than its mean speed, and the walker "
            f"{excess:.2f} m/s faster.",
            interval=resampled_interval(lambda k: float(free_m[k].mean() / even_m[k].mean()), len(fits)),
        ),
    )
    shown = fits[0]
    return Reproduction(
        claims=claims,
        note=NOTE,
        tables={
            "step": {
                "time_s": shown.time_s,
                "x_m": shown.path_m[:, 0],
                "z_m": shown.path_m[:, 1],
                "theta_rad": shown.path.theta_rad,
                "error_x_m": shown.path.error_m[:, 0],
                "error_z_m": shown.path.error_m[:, 1],
            }
        },
        drawing=render_svg(*_draw_panels(shown)),
        n=len(fits),
    )


def _excess_m_s(fit: StepFit) -> float:
    x, z = fit.path_m.T
    return float(np.gradient(x, fit.time_s)[np.argmin(z)] - np.polyfit(fit.time_s, x, 1)[0])


def _draw_panels(fit: StepFit) -> list[Panel]:
    x = fit.path_m[:, 0] - fit.path_m[0, 0]
    model = fit.path.wheel.position_m(fit.path.theta_rad)
    percent = 100 * (fit.time_s - fit.time_s[0]) / np.ptp(fit.time_s)
    even = fit.timed.wheel.position_m(fit.timed.theta0_rad + fit.timed.omega_rad_s * (fit.time_s - fit.time_s[0]))
    return [
        Panel(
            "Centre of mass and wheel (axes rescaled)",
            "ahead (m)",
            "height (m)",
            [
                Curve(x, fit.path_m[:, 1], "centre of mass", 0),
                Curve(model[:, 0] - fit.path_m[0, 0], model[:, 1], "free angles", 1, dashed=True),
                Curve(even[:, 0] - fit.path_m[0, 0], even[:, 1], "even clock", 2, dashed=True),
            ],
        ),
        Panel(
            "Error of the wheel with free angles",
            "share of the step (%)",
            "error (mm)",
            [Curve(percent, 1e3 * fit.path.error_m[:, k], axis, k) for k, axis in enumerate(("ahead", "up"))],
        ),
    ]
