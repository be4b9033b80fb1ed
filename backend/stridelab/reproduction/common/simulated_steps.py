"""Steps of one simulated subject with exact CoM and timing, used by the figures of chapter 3.

The simulation does not use the cycloid model: the horizontal CoM motion is a linear inverted pendulum with its
zero-moment point on the feet, the vertical motion a cosine per step by construction.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from stridelab.simulation.human.walker import HumanWalker, Walk
from stridelab.simulation.human_recording import SimulatedRecording, gait_events, record
from stridelab.simulation.noise import MeasurementNoise
from stridelab.walking.curtate_cycloid import Plane
from stridelab.walking.step_fit import StepFit, fit_step
from stridelab.walking.steps import GaitStep

SPEED_M_S: Final = 1.2
NOTE: Final = (
    "Simulated, because the recordings of the thesis are not public, with exact centre of mass and timing. The "
    "simulation does not use the cycloid model: forward motion of an inverted pendulum, vertical motion a cosine per "
    "step. Measured subjects are in docs/theory/rolling-wheel.md."
)


@dataclass(frozen=True)
class SimulatedSteps:
    """The walk, its recording with marker and plate noise, and the fits of all complete steps."""

    walk: Walk
    recorded: SimulatedRecording
    fits: tuple[StepFit, ...]
    path_m: Plane

    def step_and_next_support(self, fit: StepFit) -> slice:
        """Samples of the step and of the following single support."""
        k = next(i for i, other in enumerate(self.fits) if other is fit)
        strike_s = self.fits[k + 1].step.strike_s
        t = self.recorded.truth.time_s
        return slice(int(np.searchsorted(t, fit.step.lift_off_s)), int(np.searchsorted(t, strike_s)))


@lru_cache(maxsize=2)
def simulated_steps(seed: int = 0) -> SimulatedSteps:
    """Simulate and fit a walk of 5 s of a subject of 1.80 m."""
    walker = HumanWalker(height_m=1.80, mass_kg=64.0, sex="male", speed_m_s=SPEED_M_S, duration_s=5.0, seed=1 + seed)
    walk = walker.walk()
    recorded = record(walk, MeasurementNoise(force_n=5.0, moment_nm=3.0, marker_m=0.001), seed, lab="walkway")
    t, path = recorded.truth.time_s, np.asarray(recorded.truth.com_m[:, [0, 2]])
    fits = []
    for step in true_steps(walk):
        inside = (t >= step.start_s) & (t <= step.end_s)
        fits.append(fit_step(step, t[inside], path[inside]))
    return SimulatedSteps(walk, recorded, tuple(fits), path)


def true_steps(walk: Walk) -> tuple[GaitStep, ...]:
    """Planned steps, from lift-off to the next lift-off; the period is the time between strikes."""
    planned = gait_events(walk.plan)
    strikes = [event.time_s for event in planned if event.kind == "foot_strike"]
    steps = []
    for lift, other in pairwise([event for event in planned if event.kind == "foot_off"]):
        before = [s for s in strikes if s < lift.time_s]
        between = [s for s in strikes if lift.time_s < s < other.time_s]
        if before and len(between) == 1 and lift.side is not None:
            period_s = between[0] - before[-1]
            steps.append(
                GaitStep(
                    side=lift.side,
                    lift_off_s=lift.time_s,
                    strike_s=between[0],
                    next_lift_off_s=other.time_s,
                    period_s=period_s,
                    length_m=SPEED_M_S * period_s,
                    speed_m_s=SPEED_M_S,
                    measured=True,
                    source="plates",
                )
            )
    return tuple(steps)
