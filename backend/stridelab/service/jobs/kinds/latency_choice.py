"""Which latency of the force is reported, and which is taken out: never silently.

``apply`` (the default) takes out what was found where that is significant; ``report`` takes out nothing; a number is
taken out as it is. Whatever was done is a remark with the finding beside it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from stridelab.body.geometric_com import GeometricCom
from stridelab.errors import Fault, InvalidInput, NotEstimable
from stridelab.estimation.latency import LARGEST_S, Latency, estimate_latency
from stridelab.recordings.recording import Remark, WrenchTrack


@dataclass(frozen=True)
class LatencyChoice:
    """``found`` is None where the clocks could not be compared; ``applied_s`` is what the estimator gets."""

    found: Latency | None
    applied_s: float
    remarks: tuple[Remark, ...] = ()


def choose_latency(
    wanted: Literal["report", "apply"] | float,
    geometric: GeometricCom,
    wrench_at: Callable[[float], WrenchTrack],
    mass_kg: float,
) -> LatencyChoice:
    """Estimate the latency, and decide what is applied.

    Raises ``InvalidInput`` (``latency-out-of-range`` for a number beyond ``LARGEST_S``, ``mass-out-of-range``,
    ``clock-mismatch``); where the clocks cannot be compared, that is a
    remark and nothing but a stated number is applied.
    """
    stated_s = None if isinstance(wanted, str) else _possible(float(wanted))
    try:
        found = estimate_latency(geometric, wrench_at, mass_kg)
    except NotEstimable as error:
        unclear = Remark(error.code, error.message)
        if stated_s is None:
            return LatencyChoice(None, 0.0, (unclear,))
        return LatencyChoice(None, stated_s, (unclear, _applied(stated_s, "as asked.")))
    if stated_s is not None:
        return LatencyChoice(found, stated_s, (_applied(stated_s, f"as asked; found were {_found(found)}."),))
    if wanted == "apply" and found.significant:
        return LatencyChoice(
            found, found.latency_s, (_applied(found.latency_s, f"as found in this recording: {_found(found)}."),)
        )
    if wanted == "apply":
        message = (
            f"The latency of the force, {_found(found)}, cannot be told from zero: the clocks are taken as recorded."
        )
        return LatencyChoice(found, 0.0, (Remark("latency-not-significant", message),))
    if not found.significant:
        return LatencyChoice(found, 0.0)
    message = (
        f"The force seems to be {1e3 * abs(found.latency_s):.0f} ms {_sense(found.latency_s)} against the markers "
        f"({_found(found)}); this is not corrected unless the latency is applied."
    )
    return LatencyChoice(found, 0.0, (Remark("latency-not-applied", message),))


def _possible(stated_s: float) -> float:
    if not abs(stated_s) <= LARGEST_S:
        raise InvalidInput(
            "latency-out-of-range",
            f"A latency of {stated_s:g} s makes no sense: the clocks of force and markers differ by {LARGEST_S:g} s at "
            "most.",
            [Fault("latency", f"{stated_s:g} s")],
        )
    return stated_s


def _applied(latency_s: float, why: str) -> Remark:
    if latency_s == 0.0:
        return Remark("latency-applied", f"Force and markers are taken as recorded, {why}")
    message = f"The force was read {1e3 * abs(latency_s):.1f} ms {'later' if latency_s > 0.0 else 'earlier'}, {why}"
    return Remark("latency-applied", message)


def _found(found: Latency) -> str:
    axes = f"{1e3 * found.along.lag_s:.0f} ms along the walk, {1e3 * found.vertical.lag_s:.0f} ms vertically"
    return f"{1e3 * found.latency_s:.1f} ± {1e3 * found.sd_s:.1f} ms ({axes})"


def _sense(latency_s: float) -> str:
    return "late" if latency_s > 0.0 else "early"
