"""The contract that all online estimators share: one sample in, one estimate out, at a cost that never grows.

A robot or a live laboratory cannot wait for the end of a recording. An online estimator is causal and keeps a state of
fixed size; each estimator of ``estimate`` that has a causal form makes one with its method ``causal``::

    online = ComplementaryFilter().causal(mass_kg=70.0, table_sd_m=(0.009, 0.009, 0.02))
    sample = online.step(time_s, geometry_m, force_n, moment_nm)

What is missing at an instant is None: markers hidden (``geometry_m``), or not all contact force measured (``force_n``
and ``moment_nm``, together). No force at all, as in flight, is a measured force of zero.
"""

import math
from typing import NamedTuple, Protocol, runtime_checkable

from stridelab.conventions import Vector3
from stridelab.errors import Fault, InvalidInput

LONGEST_STEP_S = 1.0
"""A longer time between two samples is not bridged: the clock has jumped, or the motion is another one."""


class OnlineSample(NamedTuple):
    """The CoM at one instant, its velocity, and the standard deviation of the position per axis."""

    com_m: Vector3
    velocity_m_s: Vector3
    sd_m: Vector3


@runtime_checkable
class OnlineEstimator(Protocol):
    """What every online estimator offers."""

    def step(
        self, time_s: float, geometry_m: Vector3 | None, force_n: Vector3 | None, moment_nm: Vector3 | None
    ) -> OnlineSample:
        """Estimate at ``time_s`` from the geometric CoM and the total contact wrench about the same origin.

        Raises ``InvalidInput`` with code ``not-finite``, ``time-not-increasing``, ``time-jump`` or
        ``force-without-moment``, and ``NotEstimable`` (``geometry-missing``) as long as no sample had a geometry. After
        an error the estimator must not be used any more.
        """
        ...


def step_s(before_s: float | None, now_s: float) -> float:
    """Time since the sample before; zero for the first.

    Raises ``InvalidInput`` (``not-finite``, ``time-not-increasing``, ``time-jump``) unless a clock can have moved so.
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
    """Raise ``InvalidInput`` (``force-without-moment``) where only half of the wrench is given."""
    if (force_n is None) != (moment_nm is None):
        lacking = "moment_nm" if moment_nm is None else "force_n"
        raise InvalidInput(
            "force-without-moment", "Force and moment of a sample come together.", [Fault(lacking, "missing")]
        )
