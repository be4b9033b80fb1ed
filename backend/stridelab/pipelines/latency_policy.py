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
from stridelab.estimation.latency import MAX_LAG_S, Latency, estimate_latency, is_significant
from stridelab.recordings.recording import Remark, WrenchTrack
from stridelab.schemas.sessions import SessionValues

SIGNIFICANT_DIFFERENCE_SD: Final = 3.0
"""Difference between a trial and its session, in standard deviations, above which a remark is added."""


@dataclass(frozen=True)
class LatencyChoice:
    """``applied_s`` is corrected before estimation; ``latency_s`` and ``sd_s`` are None without an estimate.

    ``trial_estimate`` is the estimate of this trial alone, None if it has no estimate; ``session`` is set if the
    latency is the session's.
    """

    trial_estimate: Latency | None
    applied_s: float
    remarks: tuple[Remark, ...] = ()
    session: SessionValues | None = None

    @property
    def latency_s(self) -> float | None:
        """The session's latency, else the trial's."""
        if self.session is not None:
            return self.session.latency_s
        return None if self.trial_estimate is None else self.trial_estimate.latency_s

    @property
    def sd_s(self) -> float | None:
        """Standard deviation of ``latency_s``."""
        if self.session is not None:
            return self.session.latency_sd_s
        return None if self.trial_estimate is None else self.trial_estimate.sd_s

    @property
    def latency_source(self) -> Literal["session", "trial"]:
        """Whether the latency is the session's or the trial's."""
        return "trial" if self.session is None else "session"

    @property
    def citation_keys(self) -> tuple[str, ...]:
        """Citation keys of the pooling method, empty for a trial's own latency."""
        return () if self.session is None else ("huber1964", "paule1982")

    @property
    def n_trials(self) -> int:
        """Number of trials from which the latency is estimated."""
        return int(self.trial_estimate is not None) if self.session is None else self.session.latency_n_trials


def choose_latency(
    policy: Literal["report", "apply"] | float,
    geometric: GeometricCom,
    wrench_at: Callable[[float], WrenchTrack],
    mass_kg: float,
    session: SessionValues | None = None,
) -> LatencyChoice:
    """Estimate the latency and decide which value is applied.

    Raises ``InvalidInput`` (``latency-out-of-range`` for a number beyond ``MAX_LAG_S``, ``mass-out-of-range``,
    ``clock-mismatch``). If the trial allows no estimate, a remark says so and the session's or the given value is
    applied.
    """
    stated_s = None if isinstance(policy, str) else _require_latency_range(float(policy))
    remarks: tuple[Remark, ...] = ()
    of_trial = None
    try:
        of_trial = estimate_latency(geometric, wrench_at, mass_kg)
    except NotEstimable as error:
        remarks = (Remark(error.code, error.message),)
    of_session = session if session is not None and session.latency_s is not None else None
    estimated = LatencyChoice(of_trial, 0.0, remarks, of_session)
    if of_session is not None and of_trial is not None:
        remarks = (*remarks, *_session_difference_remarks(of_trial, of_session))
    latency_s, sd_s, description = estimated.latency_s, estimated.sd_s, _describe_choice(estimated)
    if stated_s is not None:
        why = "as requested." if latency_s is None else f"as requested; the estimate is {description}."
        return LatencyChoice(of_trial, stated_s, (*remarks, _applied_remark(stated_s, why)), of_session)
    if latency_s is None or sd_s is None:
        return LatencyChoice(of_trial, 0.0, remarks, of_session)
    significant = is_significant(latency_s, sd_s)
    if policy == "apply" and significant:
        where = "in this recording" if of_session is None else "in its session"
        remark = _applied_remark(latency_s, f"as estimated {where}: {description}.")
        return LatencyChoice(of_trial, latency_s, (*remarks, remark), of_session)
    if policy == "apply":
        message = f"The latency of the force, {description}, is not significant: the clocks are taken as recorded."
        return LatencyChoice(of_trial, 0.0, (*remarks, Remark("latency-not-significant", message)), of_session)
    if significant:
        message = (
            f"The force seems to be {1e3 * abs(latency_s):.0f} ms {_late_or_early(latency_s)} against the markers "
            f"({description}); this is not corrected unless the latency is applied."
        )
        remarks = (*remarks, Remark("latency-not-applied", message))
    return LatencyChoice(of_trial, 0.0, remarks, of_session)


def _session_difference_remarks(of_trial: Latency, session: SessionValues) -> tuple[Remark, ...]:
    """A remark if the latencies of the trial and of its session differ significantly."""
    mean_s, sd_s, excess_s = session.latency_s or 0.0, session.latency_sd_s or 0.0, session.latency_excess_s or 0.0
    if abs(of_trial.latency_s - mean_s) <= SIGNIFICANT_DIFFERENCE_SD * math.hypot(of_trial.sd_s, sd_s, excess_s):
        return ()
    message = (
        f"This trial alone gives {_describe_latency(of_trial)}, its session {1e3 * mean_s:.1f} ± "
        f"{1e3 * sd_s:.1f} ms: more than "
        f"{SIGNIFICANT_DIFFERENCE_SD:g} standard deviations apart."
    )
    return (Remark("latency-differs-from-session", message),)


def _require_latency_range(stated_s: float) -> float:
    if not abs(stated_s) <= MAX_LAG_S:
        raise InvalidInput(
            "latency-out-of-range",
            f"A latency of {stated_s:g} s is out of range: the clocks of force and markers may differ by at most "
            f"{MAX_LAG_S:g} s.",
            [Fault("latency", f"{stated_s:g} s")],
        )
    return stated_s


def _applied_remark(latency_s: float, why: str) -> Remark:
    if latency_s == 0.0:
        return Remark("latency-applied", f"Force and markers are taken as recorded, {why}")
    message = f"The force was read {1e3 * abs(latency_s):.1f} ms {'later' if latency_s > 0.0 else 'earlier'}, {why}"
    return Remark("latency-applied", message)


def _describe_choice(choice: LatencyChoice) -> str:
    """The latency as text, with its standard deviation and source."""
    alone = "" if choice.trial_estimate is None else _describe_latency(choice.trial_estimate)
    if choice.session is None or choice.latency_s is None or choice.sd_s is None:
        return alone
    trials = f"{choice.n_trials} trial{'' if choice.n_trials == 1 else 's'}"
    own = f"; this one alone: {alone}" if alone else ""
    return f"{1e3 * choice.latency_s:.1f} ± {1e3 * choice.sd_s:.1f} ms over {trials}{own}"


def _describe_latency(latency: Latency) -> str:
    axes = f"{1e3 * latency.along.lag_s:.0f} ms along the walk, {1e3 * latency.vertical.lag_s:.0f} ms vertically"
    return f"{1e3 * latency.latency_s:.1f} ± {1e3 * latency.sd_s:.1f} ms ({axes})"


def _late_or_early(latency_s: float) -> str:
    return "late" if latency_s > 0.0 else "early"
