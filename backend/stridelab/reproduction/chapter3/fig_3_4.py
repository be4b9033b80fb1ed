"""Figure 3.4: phases of the gait from the plates, and how the height of the CoM varies from step to step."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress, Series
from stridelab.recordings.force_windows import measured_windows
from stridelab.recordings.marker_sets import identify
from stridelab.reproduction.claims import Item, Reproduction, aimed
from stridelab.reproduction.common.simulated_steps import NOTE, SimulatedSteps, simulated_steps
from stridelab.reproduction.report.svg_plots import Curve, Panel, svg
from stridelab.walking.step_fit import StepFit
from stridelab.walking.steps import find_steps

PERCENT: Final = np.arange(101.0)
LARGEST_S: Final = 0.015
PRESSING_N: Final = 20.0


def run(seeds: int, tell: Progress) -> Reproduction:
    """One walk; ``seeds`` changes nothing."""
    tell(0.05, "a person walks")
    steps = simulated_steps()
    errors_s = _errors_s(steps)
    heights = np.array([_height_m(fit) for fit in steps.fits])
    sd = heights.std(axis=0)
    claims = (
        aimed(
            "timing_error_s",
            "two synchronized plates segment the walk precisely (largest error of a strike or lift-off)",
            float(np.abs(errors_s).max()),
            "s",
            at_most=LARGEST_S,
            note=f"{errors_s.size} instants of {len(errors_s)} steps, from the recording with its noise, against the "
            f"exact instant at which the foot presses with {PRESSING_N:.0f} N.",
        ),
    )
    tell(1.0, "done")
    return Reproduction(
        claims=claims,
        note=f"{NOTE} How much steps vary is the simulation's own choice: panel (b) is drawn, and nothing claimed.",
        tables={"height": {"percent_of_step": PERCENT, "mean_z_m": heights.mean(axis=0), "sd_z_m": sd}},
        drawing=svg(_panels(steps, heights)),
    )


def _height_m(fit: StepFit) -> Series:
    """Height about its mean at every percent of the step."""
    share = 100 * (fit.time_s - fit.time_s[0]) / np.ptp(fit.time_s)
    return np.asarray(np.interp(PERCENT, share, fit.path_m[:, 1] - fit.path_m[:, 1].mean()))


def _errors_s(steps: SimulatedSteps) -> np.ndarray:
    """Lift-off, strike, next lift-off of every step of the recording, minus the nearest exact instant of 20 N."""
    recording = steps.recorded.recording
    landmarks = identify(tuple(recording.markers_m)).landmarks
    found = find_steps(recording, landmarks, measured_windows(recording, landmarks))
    t = steps.walk.truth.time_s
    loaded = [foot.force_n[:, 2] > PRESSING_N for foot in steps.walk.feet.values()]
    strikes = np.concatenate([t[1:][on[1:] & ~on[:-1]] for on in loaded])
    lifts = np.concatenate([t[1:][on[:-1] & ~on[1:]] for on in loaded])

    def off(instant_s: float, exact_s: Series) -> float:
        return float(instant_s - exact_s[np.argmin(np.abs(exact_s - instant_s))])

    return np.array(
        [[off(s.lift_off_s, lifts), off(s.strike_s, strikes), off(s.next_lift_off_s, lifts)] for s in found]
    )


def _panels(steps: SimulatedSteps, heights: np.ndarray) -> list[Panel]:
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


ITEM: Final = Item("fig-3.4", "Phases of the gait, and the height in a step", run)
