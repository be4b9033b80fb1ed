"""All steps of adults at a comfortable (C4) and a fast speed (C5), Schreiber and Moissenet 2019, for the people items.

One trial per person and speed has two consecutive steps. All contact force is measured in the first one; the second
ends beside the plates, where the smoother extends its estimate.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from scipy.stats import chi2

from stridelab.conventions import GRAVITY_M_S2, Vector3
from stridelab.errors import NotFound
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.reproduction.common.intervals import Interval
from stridelab.reproduction.common.matching_samples import matching_samples
from stridelab.reproduction.common.recorded_walks import LeftOut, RecordedWalk, read_some
from stridelab.walking.curtate_cycloid import Plane
from stridelab.walking.double_support import double_support_of_wheel
from stridelab.walking.path_fit import fit_path
from stridelab.walking.step_fit import StepFit, fit_steps, sagittal_path_m
from stridelab.walking.steps import find_steps

SPEEDS: Final[Mapping[str, str]] = {
    "comfortable": "rehazenter-adult-walking/*/*_C4_*.c3d",
    "fast": "rehazenter-adult-walking/*/*_C5_*.c3d",
}
SOURCE: Final = (
    "Adults of Schreiber and Moissenet 2019 (doi 10.1038/s41597-019-0124-4, data at doi 10.6084/m9.figshare.7734767)"
)
PERCENT: Final = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, eq=False)
class FittedWalk:
    """All fitted steps of one person at one speed, and the recording and estimate from which they come."""

    walk: RecordedWalk
    estimate: ComEstimate
    latency_s: float
    ahead: Vector3
    fits: tuple[StepFit, ...]

    @property
    def person(self) -> str:
        """Name of the folder of the recording."""
        return self.walk.person

    @property
    def height_m(self) -> float | None:
        """Height of the person; None if the recording does not state it."""
        return self.walk.recording.subject.height_m

    def mean_of(self, value: Callable[[StepFit], float]) -> float:
        """Mean of a number over the steps."""
        return float(np.mean([value(fit) for fit in self.fits]))

    def spread_m(self, name: str) -> float:
        """Standard deviation of a parameter of the wheel between the steps; NaN for one step."""
        return _standard_deviation([getattr(fit.path.wheel, name) for fit in self.fits])

    def geometric_spread_m(self, name: str) -> float:
        """The same for wheels fitted to the geometric CoM, which does not depend on what the plates measure."""
        geometric = self.walk.geometric
        values = []
        for fit in self.fits:
            inside = matching_samples(geometric.time_s, fit.time_s)
            com_m = geometric.com_m[inside]
            path_m = np.column_stack([com_m @ self.ahead, com_m[:, 2]])
            values.append(getattr(fit_path(geometric.time_s[inside], path_m, fit.step.period_s).wheel, name))
        return _standard_deviation(values)

    def distance_mm(self, *, measured: bool) -> Interval:
        """Mean and standard deviation of the distance within a step, means of the steps; ``measured``: on plates."""
        chosen = [fit.path.distance_m for fit in self.fits if fit.step.measured or not measured]
        return (1e3 * float(np.mean([d.mean() for d in chosen])), 1e3 * float(np.mean([d.std() for d in chosen])))

    def convex_share(self) -> float:
        """Share of the length of the measured steps on which the plates carry more than the body's weight.

        The path is convex where the CoM accelerates upwards. Uses no model of the path. NaN without a measured step.
        """
        wrench = self.walk.total_wrench(self.latency_s)
        shares = []
        for fit in self.fits:
            inside = (wrench.time_s >= fit.step.start_s) & (wrench.time_s <= fit.step.end_s) & wrench.complete
            if not fit.step.measured or not inside.any():
                continue
            x = np.interp(wrench.time_s[inside], self.estimate.time_s, self.estimate.com_m @ self.ahead)
            advance = np.gradient(x)
            convex = wrench.force_n[inside, 2] > self.walk.mass_kg * GRAVITY_M_S2
            shares.append(float(advance[convex].sum() / advance.sum()))
        return float(np.mean(shares)) if shares else float("nan")

    def curve_convex_share(self) -> float:
        """The same share of the fitted curves of the measured steps; NaN without a measured step."""
        shares = []
        for fit in self.fits:
            if fit.step.measured:
                wheel, theta = fit.path.wheel, fit.path.theta_rad
                advance = np.gradient(wheel.position_m(theta)[:, 0])
                convex = wheel.R_m * np.cos(theta) > wheel.branch * wheel.r_m  # x' z'' > z' x''
                shares.append(float(advance[convex].sum() / advance.sum()))
        return float(np.mean(shares)) if shares else float("nan")

    def height_variability_m(self) -> float:
        """RMS difference of the heights of successive steps at the same share of the step, over the root of two."""
        heights = [_relative_height_m(fit.path_m) for fit in self.fits]
        return float(np.sqrt(np.mean(np.diff(heights, axis=0) ** 2) / 2.0)) if len(heights) > 1 else float("nan")

    def curve_variability_m(self) -> float:
        """The same of the fitted curves."""
        heights = [_curve_height_m(fit) for fit in self.fits]
        return float(np.sqrt(np.mean(np.diff(heights, axis=0) ** 2) / 2.0)) if len(heights) > 1 else float("nan")

    def prediction_error_m(self) -> float:
        """RMS difference of the height of each step and the curve of the step beside it, over the root of two."""
        pairs = [*zip(self.fits, self.fits[1:], strict=False), *zip(self.fits[1:], self.fits, strict=False)]
        errors_m = [_relative_height_m(fit.path_m) - _curve_height_m(other) for fit, other in pairs]
        return float(np.sqrt(np.mean(np.square(errors_m)) / 2.0)) if errors_m else float("nan")

    def event_differences_s(self) -> list[float]:
        """Strikes and lift-offs of the steps minus the closest event of the same kind that the laboratory stored."""
        stored = self.walk.recording.events
        ours = [(kind, at) for fit in self.fits for kind, at in
                (("foot_strike", fit.step.strike_s), ("foot_off", fit.step.next_lift_off_s))]  # fmt: skip
        differences = []
        for kind, at in ours:
            near = [at - event.time_s for event in stored if event.kind == kind]
            if near:
                differences.append(min(near, key=abs))
        return differences

    def double_support_errors_s(self) -> list[tuple[float, float, float]]:
        """Predicted minus measured start and end of double support, and its duration, of every step but the last.

        Both crossings of the hub's height are searched over the step and the single support after it; NaN without one.
        """
        t, path_m = self.estimate.time_s, sagittal_path_m(self.estimate, self.ahead)
        errors = []
        for fit, following in zip(self.fits, self.fits[1:], strict=False):
            step = fit.step
            first = matching_samples(t, fit.time_s).start
            inside = slice(first, int(np.searchsorted(t, following.step.strike_s, side="right")))
            wheel = fit_path(t[inside], path_m[inside], step.period_s)
            start, end = double_support_of_wheel(wheel, t[inside], (step.strike_s + step.next_lift_off_s) / 2.0)
            errors.append((
                float("nan") if start is None else start - step.strike_s,
                float("nan") if end is None else end - step.next_lift_off_s,
                step.next_lift_off_s - step.strike_s,
            ))  # fmt: skip
        return errors


Walks = Mapping[str, Sequence[FittedWalk]]
"""Fitted walks by speed."""


@lru_cache(maxsize=1)
def fitted_walks(gait: Path) -> tuple[Walks, tuple[LeftOut, ...]]:
    """All adults below the folder ``gait`` by speed, and the recordings that cannot be used.

    A speed at which there is none is left out. Raises ``NotFound`` (``recordings-missing``) if there is none at all.
    """
    walks: dict[str, tuple[FittedWalk, ...]] = {}
    left_out: list[LeftOut] = []
    missing: list[NotFound] = []
    for speed, pattern in SPEEDS.items():
        try:
            fitted, unused = read_some(gait, pattern, lambda path: fit_walk(RecordedWalk.from_file(path)))
        except NotFound as error:
            missing.append(error)
            continue
        walks[speed] = tuple(fitted)
        left_out += unused
    if not walks:
        raise missing[0]
    return walks, tuple(left_out)


def fit_walk(walk: RecordedWalk) -> FittedWalk:
    """Estimate the centre of mass, also beside the plates, and fit the wheel to all whole steps."""
    latency = estimate_latency(walk.geometric, walk.total_wrench, walk.mass_kg)
    latency_s = latency.latency_s if latency.significant else 0.0
    estimate = Smoother(beyond_window=True).estimate(walk.geometric, walk.total_wrench(latency_s), walk.mass_kg)
    landmarks = identify(list(walk.recording.markers_m)).landmarks
    steps = find_steps(walk.recording, landmarks, walk.windows, latency_s=latency_s)
    stated = walk.recording.walking_direction
    ahead = walk_frame(estimate.velocity_m_s)[0] if stated is None else stated
    return FittedWalk(walk, estimate, latency_s, ahead, fit_steps(estimate, steps, ahead, walk.windows))


def pooled_spread(spreads_m: Sequence[float]) -> tuple[float, Interval]:
    """Pooled standard deviation of pairs of steps, and its 95 % interval by the chi-squared distribution."""
    known = np.array([spread_m for spread_m in spreads_m if np.isfinite(spread_m)])
    squares = float(np.sum(known**2))
    low, high = np.sqrt(squares / chi2.ppf((0.975, 0.025), len(known))).tolist()
    return float(np.sqrt(squares / len(known))), (low, high)


def path_of(fit: StepFit) -> Plane:
    """The centre of mass relative to the hub of its wheel."""
    return np.asarray(fit.path_m - fit.path.wheel.hub_m(fit.path.theta_rad))


def _relative_height_m(path_m: Plane) -> np.ndarray:
    """Height about its mean at each per cent of a step."""
    heights = path_m[:, 1] - path_m[:, 1].mean()
    return np.asarray(np.interp(PERCENT, np.linspace(0.0, 1.0, len(heights)), heights))


def _curve_height_m(fit: StepFit) -> np.ndarray:
    return _relative_height_m(fit.path.wheel.position_m(fit.path.theta_rad))


def _standard_deviation(values: Sequence[float]) -> float:
    return float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
