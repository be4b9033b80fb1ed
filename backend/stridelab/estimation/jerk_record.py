"""One record made ready for the model of section 2.5.3, and what a pass over it gives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stridelab.body.geometric_com import GeometricCom
from stridelab.estimation.derivatives import derivatives, low_pass
from stridelab.estimation.error_band import FusedStretch, stated_sd_m
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.estimate import ComEstimate
from stridelab.estimation.kalman_passes import Axis, Inputs, Track
from stridelab.estimation.passes import FilterInputs
from stridelab.estimation.riccati import Starts
from stridelab.estimation.span import Span

Pass = Callable[[Axis, Inputs, Starts], Track]
"""``Axis.filtered`` or ``Axis.smoothed``."""


@dataclass(frozen=True)
class JerkRecord:
    """The three inputs over the gap-free geometry and an ``Axis`` for each of x, y, z.

    Outside the window only the geometry of ``inputs`` is read.
    """

    geometric: GeometricCom
    span: Span
    inputs: FilterInputs
    stretch: FusedStretch
    axes: tuple[Axis, Axis, Axis]
    priors: ErrorPriors

    def estimate(self, passed: Pass, method: str, references: tuple[str, ...]) -> ComEstimate:
        """The fused window.

        ``sd_m`` joins the stated errors, sent through the pass, and what the pass does to a motion on which all inputs
        agree: a smooth copy of the geometry stands for the true motion. ``model_sd_*_m`` in the diagnostics is what
        the model itself believes.
        """
        within, rate_hz = self.stretch.within, self.span.rate_hz
        motion = low_pass(self.inputs.geometry_m, rate_hz)
        agreed = FilterInputs(motion, derivatives(motion, rate_hz)[1], motion)
        tracks = self._run(passed, [self.inputs, agreed])
        left_behind = (_positions(tracks)[1] - motion)[within]
        stated = stated_sd_m(
            lambda errors: list(_positions(self._run(passed, errors))), self.stretch, self.geometric.sd_m, self.priors
        )
        c, v, a = np.stack([t.mean[0, within] for t in tracks], axis=-1).transpose(1, 0, 2)
        believed = np.sqrt([t.covariance[within, 0, 0].mean() for t in tracks]).tolist()
        return ComEstimate(
            method=method,
            time_s=self.geometric.time_s[self.span.inside],
            com_m=c,
            velocity_m_s=v,
            acceleration_m_s2=a,
            sd_m=np.hypot(stated, left_behind),
            window=self.span.window,
            references=references,
            diagnostics={
                "sigma_jerk_m_s3": self.axes[0].model.sigma_jerk_m_s3,
                **{f"model_sd_{name}_m": sd for name, sd in zip("xyz", believed, strict=True)},
            },
        )

    def _run(self, passed: Pass, inputs: Sequence[FilterInputs]) -> list[Track]:
        """One pass of every axis over several sets of inputs; each starts at its first geometry, at rest."""
        tracks = []
        for j, axis in enumerate(self.axes):
            y = np.array([[i.geometry_m[:, j], i.acceleration_m_s2[:, j], i.axis_point_m[:, j]] for i in inputs])
            start = np.zeros((len(y), 3))
            start[:, 0] = y[:, 0, 0]
            tracks.append(passed(axis, np.ascontiguousarray(y.transpose(0, 2, 1)), start))
        return tracks


def _positions(tracks: Sequence[Track]) -> Float[np.ndarray, "sets n 3"]:
    return np.stack([t.mean[:, :, 0] for t in tracks], axis=-1)
