"""Figure 3.4: gait phases from the force plates, and variation of the CoM height between steps."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress, Series
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.reproduction.claims import Reproduction, reproduces, target
from stridelab.reproduction.common.simulated_steps import NOTE, SimulatedSteps, simulated_steps
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.walking.step_fit import StepFit
from stridelab.walking.steps import find_steps

PERCENT: Final = np.arange(101.0)
MAX_TIMING_ERROR_S: Final = 0.015
LOADED_N: Final = 20.0


@reproduces("fig-3.4", "Phases of the gait, and the height in a step", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """One simulated walk."""
    tell(0.05, "simulating a walk")
    steps = simulated_steps(seeds[0])
    errors_s = _event_errors_s(steps)
    heights = np.array([_height_m(fit) for fit in steps.fits])
    sd = heights.std(axis=0)
    claims = (
        target("timing_error_s", float(np.abs(errors_s).max()), "s", at_most=MAX_TIMING_ERROR_S).says(
            "two synchronized plates segment the walk precisely (largest error of a strike or lift-off)",
            f"{errors_s.size} events of {len(errors_s)} steps, from the recording with noise, compared with the "
            f"exact time at which the foot force crosses {LOADED_N:.0f} N. Steps timed by markers too are left out.",
            cases_inside=int((np.abs(errors_s) <= MAX_TIMING_ERROR_S).sum()),
            comparator="exact foot forces",
        ),
    )
    return Reproduction(
        claims=claims,
        note=f"{NOTE} The variation between steps is a parameter of the simulation: panel (b) is drawn without claims.",
        tables={"height": {"percent_of_step": PERCENT, "mean_z_m": heights.mean(axis=0), "sd_z_m": sd}},
        drawing=render_svg(*_draw_panels(steps, heights)),
        n=errors_s.size,
    )


def _height_m(fit: StepFit) -> Series:
    """Height minus its mean at every percent of the step."""
    share = 100 * (fit.time_s - fit.time_s[0]) / np.ptp(fit.time_s)
    return np.asarray(np.interp(PERCENT, share, fit.path_m[:, 1] - fit.path_m[:, 1].mean()))


def _event_errors_s(steps: SimulatedSteps) -> np.ndarray:
    """Errors of lift-off, strike and next lift-off of every step on plates, from the closest exact event; (n, 3)."""
    recording = steps.recorded.recording
    landmarks = identify(tuple(recording.markers_m)).landmarks
    steps_of_recording = find_steps(recording, landmarks, measured_windows(recording, landmarks))
    t = steps.walk.truth.time_s
    loaded = [foot.force_n[:, 2] > LOADED_N for foot in steps.walk.feet.values()]
    strikes = np.concatenate([t[1:][on[1:] & ~on[:-1]] for on in loaded])
    lift_offs = np.concatenate([t[1:][on[:-1] & ~on[1:]] for on in loaded])

    def closest_difference_s(instant_s: float, exact_s: Series) -> float:
        return float(instant_s - exact_s[np.argmin(np.abs(exact_s - instant_s))])

    return np.array(
        [
            [
                closest_difference_s(s.lift_off_s, lift_offs),
                closest_difference_s(s.strike_s, strikes),
                closest_difference_s(s.next_lift_off_s, lift_offs),
            ]
            for s in steps_of_recording
            if s.source == "plates"
        ]
    )


def _draw_panels(steps: SimulatedSteps, heights: np.ndarray) -> list[Panel]:
    t = steps.walk.truth.time_s
    shown = (t >= steps.fits[0].step.start_s) & (t <= steps.fits[2].step.end_s)
    feet = [
        Curve(t[shown], foot.force_n[shown, 2], f"{side} foot", k)
        for k, (side, foot) in enumerate(sorted(steps.walk.feet.items()))
    ]
    gap = np.full((len(heights), 1), np.nan)
    every_step = np.hstack([1e3 * heights, gap]).ravel()
    shares = np.tile(np.append(PERCENT, np.nan), len(heights))
    return [
        Panel("Vertical force: single and double support", "time (s)", "force (N)", feet),
        Panel(
            "Height of the centre of mass in a step",
            "share of the step (%)",
            "height (mm)",
            [
                Curve(shares, every_step, "steps", 5),
                Curve(PERCENT, 1e3 * heights.mean(axis=0), "mean", 6, dashed=True),
            ],
        ),
    ]
