"""Figure 2.8 on real recordings: difference between the thesis' filter and the geometry for walks over force plates.

Adults at a comfortable (C4) and a fast speed (C5), Schreiber and Moissenet 2019. The true CoM is unknown, but an error
of the segment table is the same at both speeds, and a delayed force displaces the estimate by speed times delay.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Progress, Vector3
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.latency import estimate_latency
from stridelab.reproduction.chapter2.fig_2_8 import com_and_force_panels
from stridelab.reproduction.claims import Claim, Measured, Reproduction, at_least, target
from stridelab.reproduction.common.estimator_errors import as_columns, rms
from stridelab.reproduction.common.intervals import resampled_interval
from stridelab.reproduction.common.matching_samples import matching_samples
from stridelab.reproduction.common.recorded_walks import LeftOut, RecordedWalk, left_out_text, read_some
from stridelab.reproduction.report.svg_plots import Bars, render_svg

NAME: Final = "fig-2.8-people"
TITLE: Final = "Walking on force plates, real recordings"
PRINTED: Final[tuple[str, ...]] = ()
"""No tables: their rows would be individual subjects."""
COMFORTABLE, FAST = (f"rehazenter-adult-walking/*/*_{speed}_*.c3d" for speed in ("C4", "C5"))
THESIS_HEIGHT_M: Final = 1.80
WALK, SIDE, UP = range(3)
CHANCE_CHANGE_M: Final = 0.0025
"""Change of the offset with the speed below which it is attributed to chance."""


@dataclass(frozen=True, eq=False)
class Fused:
    """Estimate of one walk by the thesis' filter without latency correction, and offsets without and with correction.

    Offsets are the mean of fused minus geometric CoM over the window: along the walk, to the left and up.
    """

    walk: RecordedWalk
    estimate: ComEstimate
    speed_m_s: float
    latency_s: float
    offset_m: Vector3
    corrected_m: Vector3


def run(gait: Path, tell: Progress) -> Reproduction:
    """All adults below the folder ``gait`` whose recordings can be used.

    Raises ``NotFound`` (``recordings-missing``) if there are none at a speed.
    """
    walks: dict[str, list[Fused]] = {}
    left_out: list[LeftOut] = []
    for k, pattern in enumerate((COMFORTABLE, FAST)):
        tell(k / 2, "comfortable" if pattern == COMFORTABLE else "fast")
        walks[pattern], unused = read_some(gait, pattern, lambda path: fuse_walk(RecordedWalk.from_file(path)))
        left_out += unused
    slow, fast = ({one.walk.person: one for one in walks[pattern]} for pattern in (COMFORTABLE, FAST))
    pairs = [(slow[person], fast[person]) for person in sorted(slow.keys() & fast.keys())]
    shown = min(slow.values(), key=lambda one: abs((one.walk.recording.subject.height_m or 0.0) - THESIS_HEIGHT_M))
    tell(1.0, "done")
    return Reproduction(
        claims=_offset_claims(list(slow.values()), pairs),
        note=f"{len(slow)} adults at a comfortable and {len(fast)} at a fast speed, the thesis' filter, segment table "
        "of Dumas. The latency of the force is first left uncorrected, since the thesis does not mention it, and then "
        "corrected by its estimate. The drawing shows the subject whose height is closest to that of the thesis' "
        f"subject.{left_out_text(left_out)}",
        tables={
            "walks": as_columns(
                [_walk_row(pace, one) for pace, of in (("comfortable", slow), ("fast", fast)) for one in of.values()]
            )
        },
        drawing=render_svg(
            *com_and_force_panels(shown.walk.geometric, shown.estimate, shown.walk.total_wrench(0.0)),
            Bars(
                "Offset along the walk, mean",
                "mm",
                [
                    (f"{pace}, {clocks}", 1e3 * float(np.mean([getattr(one, name)[WALK] for one in of.values()])))
                    for pace, of in (("comfortable", slow), ("fast", fast))
                    for clocks, name in (("uncorrected", "offset_m"), ("corrected", "corrected_m"))
                ],
            ),
        ),
        references=("carpentier2017thesis", "carpentier2016spectral", "dumas2007"),
    ).with_basis("people", len(pairs))


def fuse_walk(walk: RecordedWalk) -> Fused:
    """Apply the thesis' filter to one walk, without and with latency correction."""
    latency = estimate_latency(walk.geometric, walk.total_wrench, walk.mass_kg)
    latency_s = latency.latency_s if latency.significant else 0.0
    uncorrected, corrected = (_thesis_estimate(walk, read_later_s) for read_later_s in (0.0, latency_s))
    speed = float(np.linalg.norm(np.mean(uncorrected.velocity_m_s, axis=0)[:UP]))
    return Fused(walk, uncorrected, speed, latency_s, _offset_m(walk, uncorrected), _offset_m(walk, corrected))


def _thesis_estimate(walk: RecordedWalk, read_later_s: float) -> ComEstimate:
    return ComplementaryFilter.thesis().estimate(walk.geometric, walk.total_wrench(read_later_s), walk.mass_kg)


def _offset_m(walk: RecordedWalk, estimate: ComEstimate) -> Vector3:
    geometry = walk.geometric.com_m[matching_samples(walk.geometric.time_s, estimate.time_s)]
    return np.asarray(walk_frame(estimate.velocity_m_s) @ (estimate.com_m - geometry).mean(axis=0))


def _walk_row(pace: str, one: Fused) -> dict[str, object]:
    along, left, up = one.offset_m.tolist()
    return {
        "person": one.walk.person,
        "pace": pace,
        "speed_m_s": one.speed_m_s,
        "latency_s": one.latency_s,
        "along_m": along,
        "left_m": left,
        "up_m": up,
        "along_corrected_m": float(one.corrected_m[WALK]),
    }


def _offset_claims(slow: Sequence[Fused], pairs: Sequence[tuple[Fused, Fused]]) -> tuple[Claim, ...]:
    flat_m, up_m = (np.array([one.offset_m[axes] for one in slow]) for axes in (slice(WALK, UP), slice(UP, None)))
    flat, up = rms(flat_m.ravel().tolist()), rms(up_m.ravel().tolist())

    def horizontal_over_vertical(chosen: Sequence[int]) -> float:
        return rms(flat_m[chosen].ravel().tolist()) / rms(up_m[chosen].ravel().tolist())

    raw, corrected = (
        np.array([getattr(b, name)[WALK] - getattr(a, name)[WALK] for a, b in pairs])
        for name in ("offset_m", "corrected_m")
    )
    late = np.mean([b.speed_m_s * b.latency_s - a.speed_m_s * a.latency_s for a, b in pairs])
    change, left = abs(float(raw.mean())), abs(float(corrected.mean()))
    return (
        Measured("horizontal_over_vertical", "especially", flat / up, "1", at_least(1.0, "words")).says(
            "the estimate differs slightly from the geometry, especially in horizontal position",
            f"RMS of the mean offsets of {len(slow)} adults at a comfortable speed: {1e3 * flat:.1f} mm per horizontal "
            f"axis, {1e3 * up:.1f} mm vertically.",
            n=len(slow),
            interval=resampled_interval(horizontal_over_vertical, len(slow)),
            comparator="vertical offset",
        ),
        target("change_with_speed_m", change, "m", at_most=CHANCE_CHANGE_M).says(
            "the offset does not depend on the speed, as if it corrected the table, which the thesis thinks possible",
            f"Mean change of the offset along the walk from comfortable to fast, {len(pairs)} adults: "
            f"{1e3 * raw.mean():+.1f} mm, standard deviation {1e3 * raw.std():.1f} mm; speed times latency grows by "
            f"{1e3 * late:.1f} mm.",
            interval=resampled_interval(lambda chosen: abs(float(raw[chosen].mean())), len(pairs)),
        ),
        target("change_corrected_over_raw", left / change, "1", at_most=1.0).says(
            "the same with the latency corrected, over that without correction",
            f"{1e3 * corrected.mean():+.1f} mm remain, standard deviation {1e3 * corrected.std():.1f} mm.",
            interval=resampled_interval(
                lambda chosen: abs(float(corrected[chosen].mean())) / abs(float(raw[chosen].mean())), len(pairs)
            ),
            comparator="latency not corrected",
        ),
    )
