"""Which latency of the force is reported, and which is applied: never silently, and never more than asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from stridelab.body.geometric_com import GeometricCom
from stridelab.errors import NotEstimable
from stridelab.estimation.latency import Latency, estimate_latency
from stridelab.recordings.recording import Remark, WrenchTrack

NOTABLE_S = 0.004
"""An unapplied latency from here on is worth a remark: at walking speed it moves the CoM by 5 mm or more."""


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

    Raises ``NotEstimable`` where it is to be applied but cannot be told; otherwise that is a remark.
    """
    try:
        found = estimate_latency(geometric, wrench_at, mass_kg)
    except NotEstimable as error:
        if wanted == "apply":
            raise
        applied_s = 0.0 if wanted == "report" else float(wanted)
        return LatencyChoice(None, applied_s, (Remark(error.code, error.message),))
    if wanted == "apply":
        return LatencyChoice(found, found.latency_s)
    if wanted != "report":
        return LatencyChoice(found, float(wanted))
    if abs(found.latency_s) < NOTABLE_S:
        return LatencyChoice(found, 0.0)
    late = "late" if found.latency_s > 0.0 else "early"
    message = (
        f"The force seems to be {1e3 * abs(found.latency_s):.0f} ms {late} against the markers; this is not corrected "
        "unless the latency is applied."
    )
    return LatencyChoice(found, 0.0, (Remark("latency-not-applied", message),))
