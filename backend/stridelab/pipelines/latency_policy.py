"""Latency of the force relative to the markers: which value is reported and which is corrected.

``apply`` (the default) corrects the estimated latency if it is significant; ``report`` corrects nothing; a number is
corrected as given. A remark records the correction together with the estimate. If other trials of the session have an
estimate, the latency is the session's pooled value.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from stridelab.body.geometric_com import GeometricCom
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.estimation.latency import LARGEST_S, Latency, estimate_latency, is_significant
from stridelab.recordings.recording import Remark, WrenchTrack
from stridelab.schemas.sessions import SessionValues

APART: Final = 3.0
"""Difference between a trial and its session, in standard deviations, above which a remark is added."""


@dataclass(frozen=True)
class LatencyChoice:
    """``applied_s`` is corrected before estimation; ``latency_s`` and ``sd_s`` are None without an estimate.

    ``found`` is the estimate of this trial alone, None if it has no estimate; ``session`` is set if the latency is the
    session's.
    """

    found: Latency | None
    applied_s: float
    remarks: tuple[Remark, ...] = ()
    session: SessionValues | None = None

    @property
    def latency_s(self) -> float | None:
        """The session's latency, else the trial's."""
        if self.session is not None:
            return self.session.latency_s
        return None if self.found is None else self.found.latency_s

    @property
    def sd_s(self) -> float | None:
        """Standard deviation of ``latency_s``."""
        if self.session is not None:
            return self.session.latency_sd_s
        return None if self.found is None else self.found.sd_s

    @property
    def source(self) -> Literal["session", "trial"]:
        """Whether the latency is the session's or the trial's."""
        return "trial" if self.session is None else "session"

    @property
    def references(self) -> tuple[str, ...]:
        """Citation keys of the pooling method, empty for a trial's own latency."""
        return () if self.session is None else ("huber1964", "paule1982")

    @property
    def n_trials(self) -> int:
        """Number of trials from which the latency is estimated."""
        return int(self.found is not None) if self.session is None else self.session.latency_n_trials


def choose_latency(
    wanted: Literal["report", "apply"] | float,
    geometric: GeometricCom,
    wrench_at: Callable[[float], WrenchTrack],
    mass_kg: float,
    session: SessionValues | None = None,
) -> LatencyChoice:
    """Estimate the latency and decide which value is applied.

    Raises ``InvalidInput`` (``latency-out-of-range`` for a number beyond ``LARGEST_S``, ``mass-out-of-range``,
    ``clock-mismatch``). If the trial allows no estimate, a remark says so and the session's or the given value is
    applied.
    """
    stated_s = None if isinstance(wanted, str) else _possible(float(wanted))
    remarks: tuple[Remark, ...] = ()
    of_trial = None
    try:
        of_trial = estimate_latency(geometric, wrench_at, mass_kg)
    except NotEstimable as error:
        remarks = (Remark(error.code, error.message),)
    of_session = session if session is not None and session.latency_s is not None else None
    estimated = LatencyChoice(of_trial, 0.0, remarks, of_session)
    if of_session is not None and of_trial is not None:
        remarks = (*remarks, *_difference(of_trial, of_session))
    latency_s, sd_s, description = estimated.latency_s, estimated.sd_s, _said(estimated)
    if stated_s is not None:
        why = "as requested." if latency_s is None else f"as requested; the estimate is {description}."
        return LatencyChoice(of_trial, stated_s, (*remarks, _applied(stated_s, why)), of_session)
    if latency_s is None or sd_s is None:
        return LatencyChoice(of_trial, 0.0, remarks, of_session)
    significant = is_significant(latency_s, sd_s)
    if wanted == "apply" and significant:
        where = "in this recording" if of_session is None else "in its session"
        remark = _applied(latency_s, f"as estimated {where}: {description}.")
        return LatencyChoice(of_trial, latency_s, (*remarks, remark), of_session)
    if wanted == "apply":
        message = f"The latency of the force, {description}, is not significant: the clocks are taken as recorded."
        return LatencyChoice(of_trial, 0.0, (*remarks, Remark("latency-not-significant", message)), of_session)
    if significant:
        message = (
            f"The force seems to be {1e3 * abs(latency_s):.0f} ms {_sense(latency_s)} against the markers "
            f"({description}); this is not corrected unless the latency is applied."
        )
        remarks = (*remarks, Remark("latency-not-applied", message))
    return LatencyChoice(of_trial, 0.0, remarks, of_session)


def _difference(found: Latency, session: SessionValues) -> tuple[Remark, ...]:
    """A remark if the latencies of the trial and of its session differ significantly."""
    mean_s, sd_s, excess_s = session.latency_s or 0.0, session.latency_sd_s or 0.0, session.latency_excess_s or 0.0
    if abs(found.latency_s - mean_s) <= APART * math.hypot(found.sd_s, sd_s, excess_s):
        return ()
    message = (
        f"This trial alone gives {_found(found)}, its session {1e3 * mean_s:.1f} ± {1e3 * sd_s:.1f} ms: more than "
        f"{APART:g} standard deviations apart."
    )
    return (Remark("latency-differs-from-session", message),)


def _possible(stated_s: float) -> float:
    if not abs(stated_s) <= LARGEST_S:
        raise InvalidInput(
            "latency-out-of-range",
            f"A latency of {stated_s:g} s is out of range: the clocks of force and markers may differ by at most "
            f"{LARGEST_S:g} s.",
            [Fault("latency", f"{stated_s:g} s")],
        )
    return stated_s


def _applied(latency_s: float, why: str) -> Remark:
    if latency_s == 0.0:
        return Remark("latency-applied", f"Force and markers are taken as recorded, {why}")
    message = f"The force was read {1e3 * abs(latency_s):.1f} ms {'later' if latency_s > 0.0 else 'earlier'}, {why}"
    return Remark("latency-applied", message)


def _said(known: LatencyChoice) -> str:
    """The latency as text, with its standard deviation and source."""
    alone = "" if known.found is None else _found(known.found)
    if known.session is None or known.latency_s is None or known.sd_s is None:
        return alone
    trials = f"{known.n_trials} trial{'' if known.n_trials == 1 else 's'}"
    own = f"; this one alone: {alone}" if alone else ""
    return f"{1e3 * known.latency_s:.1f} ± {1e3 * known.sd_s:.1f} ms over {trials}{own}"


def _found(found: Latency) -> str:
    axes = f"{1e3 * found.along.lag_s:.0f} ms along the walk, {1e3 * found.vertical.lag_s:.0f} ms vertically"
    return f"{1e3 * found.latency_s:.1f} ± {1e3 * found.sd_s:.1f} ms ({axes})"


def _sense(latency_s: float) -> str:
    return "late" if latency_s > 0.0 else "early"
