"""Interface of all online estimators: one sample in, one estimate out, at constant cost.

A robot or a live measurement cannot wait for the end of a recording. An online estimator is causal and has a state of
fixed size; an offline estimator with a causal form creates one with its method ``causal``::

    online = ComplementaryFilter().causal(mass_kg=70.0, table_sd_m=(0.009, 0.009, 0.02))
    sample = online.step(time_s, geometry_m, force_n, moment_nm)

Missing inputs are None: ``geometry_m`` if markers are hidden, ``force_n`` and ``moment_nm`` (both) if not all contact
force is measured. In flight the force is measured and zero.
"""

import math
from typing import NamedTuple, Protocol, runtime_checkable

from stridelab.conventions import Vector3
from stridelab.errors import Fault, InvalidInput

LONGEST_STEP_S = 1.0
"""Longest accepted time between two samples; a longer one is a jump of the clock or a different motion."""


class OnlineSample(NamedTuple):
    """The CoM at one instant, its velocity, and the standard deviation of the position per axis."""

    com_m: Vector3
    velocity_m_s: Vector3
    sd_m: Vector3


@runtime_checkable
class OnlineEstimator(Protocol):
    """Protocol of the online estimators."""

    def step(
        self, time_s: float, geometry_m: Vector3 | None, force_n: Vector3 | None, moment_nm: Vector3 | None
    ) -> OnlineSample:
        """Estimate at ``time_s`` from the geometric CoM and the total contact wrench about the same origin.

        Raises ``InvalidInput`` with code ``not-finite``, ``time-not-increasing``, ``time-jump`` or
        ``force-without-moment``, and ``NotEstimable`` (``geometry-missing``) until the first sample with a geometry.
        After an error the estimator must not be used any more.
        """
        ...


def step_s(before_s: float | None, now_s: float) -> float:
    """Time since the previous sample; zero for the first.

    Raises ``InvalidInput`` (``not-finite``, ``time-not-increasing``, ``time-jump``) for an invalid time.
    """
    if not math.isfinite(now_s):
        raise InvalidInput("not-finite", "The time of a sample is not a number.", [Fault("time_s", "not finite")])
    if before_s is None:
        return 0.0
    if now_s <= before_s:
        what = "stands still" if now_s == before_s else "jumps back"
        raise InvalidInput(
            "time-not-increasing",
            f"Time {what}: a sample at {now_s:g} s follows one at {before_s:g} s.",
            [Fault("time_s", f"{now_s:g} after {before_s:g}")],
        )
    if now_s - before_s > LONGEST_STEP_S:
        raise InvalidInput(
            "time-jump",
            f"Time jumps by {now_s - before_s:g} s, from {before_s:g} to {now_s:g} s; at most {LONGEST_STEP_S:g} s can "
            "be bridged.",
            [Fault("time_s", f"{now_s:g} after {before_s:g}")],
        )
    return now_s - before_s


def require_together(force_n: Vector3 | None, moment_nm: Vector3 | None) -> None:
    """Raise ``InvalidInput`` (``force-without-moment``) if only one of force and moment is given."""
    if (force_n is None) != (moment_nm is None):
        lacking = "moment_nm" if moment_nm is None else "force_n"
        raise InvalidInput(
            "force-without-moment", "A sample needs both force and moment, or neither.", [Fault(lacking, "missing")]
        )
