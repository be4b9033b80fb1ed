"""Figure 2.9 on people: runners on a treadmill at 2 to 5 m/s (Hamner and Delp 2013), the thesis' filter and geometry.

On a treadmill the body stays in place, so that a delay of the force does not displace the estimate as over ground.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import Mask, Points, Progress, Series, Vector3
from stridelab.dynamics.wrench import AXIS_THRESHOLD_N, Wrench
from stridelab.errors import NotFound
from stridelab.estimation.complementary.forward_backward import filter_inputs, forward_backward
from stridelab.estimation.complementary.transfer_functions import THESIS_HIGH_HZ, THESIS_LOW_HZ, complementary_filters
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, at_most, target, within
from stridelab.reproduction.common.estimator_errors import as_columns
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.common.recorded_walks import RecordedWalk, left_out_text, read_each, recordings_in
from stridelab.reproduction.report.svg_plots import Bars, Curve, Panel, render_svg

NAME: Final = "fig-2.9-people"
TITLE: Final = "Running, with flight phases, real recordings"
PRINTED: Final = ("offsets",)
RUNS: Final = "running/*/Run_*.trc"
SPEEDS: Final = (2, 3, 4, 5)
"""Speeds in m/s, which are the numbers of the files."""
LIKE_THESIS: Final = 4
"""The speed closest to the 4.4 m/s of the thesis' subject."""
FEW_M: Final = (0.01, 0.05)
"""A few centimetres."""
SETTLED_S: Final = 1.5
SAME_M: Final = 0.005
"""Largest change of an offset that still counts as the same."""
SHIFT_M: Final = 0.03
AXES: Final = ("along the run", "to the left", "up")


@dataclass(frozen=True, eq=False)
class FusedRun:
    """One run: fused minus geometric CoM at every sample, axes ahead, left, up.

    ``left_over`` is the share per axis of a constant bias of the geometry that the filter leaves; ``aloft`` the share
    of time in flight, both after ``SETTLED_S`` and before as much from the end.
    """

    person: str
    speed_m_s: int
    mass_kg: float
    time_s: Series
    offset_m: Points
    left_over: Vector3
    aloft: float

    @property
    def settled_samples(self) -> Mask:
        """Samples at least ``SETTLED_S`` from both ends."""
        return settled_samples_of(self.time_s)

    @property
    def mean_m(self) -> Vector3:
        """Mean offset."""
        return np.asarray(self.offset_m[self.settled_samples].mean(axis=0))

    @property
    def drift_m(self) -> Vector3:
        """Mean of the second half of the settled samples minus that of the first."""
        first, second = np.array_split(self.offset_m[self.settled_samples], 2)
        return np.asarray(second.mean(axis=0) - first.mean(axis=0))


def settled_samples_of(time_s: Series) -> Mask:
    """Samples at least ``SETTLED_S`` from both ends."""
    return np.asarray((time_s >= time_s[0] + SETTLED_S) & (time_s <= time_s[-1] - SETTLED_S))


def run(gait: Path, tell: Progress) -> Reproduction:
    """All runners below ``gait/running``. Raises ``NotFound`` (``recordings-missing``) if there are none."""
    paths = recordings_in(gait, RUNS)

    def fuse_and_tell(path: Path) -> FusedRun:
        tell(paths.index(path) / len(paths), path.parent.name)
        return fuse_run(path)

    runs, left_out = read_each(paths, fuse_and_tell)
    by_speed = {speed: [one for one in runs if one.speed_m_s == speed] for speed in SPEEDS}
    if not by_speed[LIKE_THESIS]:
        raise NotFound("recordings-missing", f"There is no run at {LIKE_THESIS} m/s with measured forces.")
    shown = by_speed[LIKE_THESIS][0]
    tell(1.0, "done")
    people = {one.person for one in runs}
    return Reproduction(
        claims=(*_size_claims(by_speed[LIKE_THESIS]), *_constancy_claims(by_speed), *_rule_claims(runs)),
        note=f"{len(people)} runners on a treadmill with two plates at 2, 3, 4 and 5 m/s (Hamner and Delp 2013), "
        f"{len(runs)} runs, {len(left_out)} refused; the thesis' filter, segment table of Dumas, mass from the plates. "
        f"The thesis' subject ran at 4.4 m/s; its rows are those at {LIKE_THESIS} m/s. Intervals are bootstrapped over "
        f"people.{left_out_text(left_out)}",
        tables={"offsets": _offset_table(by_speed), "runs": as_columns([_run_row(one) for one in runs])},
        drawing=render_svg(
            Panel(
                f"One runner at {LIKE_THESIS} m/s: fused minus geometric centre of mass",
                "time (s)",
                "mm",
                [Curve(shown.time_s, 1e3 * shown.offset_m[:, k], axis, k) for k, axis in enumerate(AXES)],
            ),
            Bars(
                "Mean offset along the run",
                "mm",
                [(f"{speed} m/s", 1e3 * _mean(of, lambda one: one.mean_m[0])) for speed, of in by_speed.items() if of],
            ),
        ),
        references=("carpentier2017thesis", "carpentier2016spectral", "hamner2013", "dumas2007"),
    ).with_basis("people", len(people), "figure 2.9")


def fuse_run(path: Path) -> FusedRun:
    """Apply the thesis' filter to one run.

    Raises ``NotFound`` (``recordings-missing``) if the recording does not show where the runner faces, and the errors
    of ``RecordedWalk.from_file``.
    """
    walk = RecordedWalk.from_file(path)
    wrench = walk.total_wrench(0.0)
    used = wrench.complete & np.isfinite(walk.geometric.com_m).all(axis=1)
    g, total = walk.geometric.com_m[used], Wrench(wrench.force_n[used], wrench.moment_nm[used])
    filters = complementary_filters(THESIS_LOW_HZ, THESIS_HIGH_HZ, walk.recording.marker_rate_hz)

    def fuse(geometry_m: Points) -> Points:
        return np.asarray(forward_backward(filters, filter_inputs(geometry_m, total, walk.mass_kg)))

    ahead = walk.recording.walking_direction
    if ahead is None:
        raise NotFound("recordings-missing", f"{path.name} does not show where the runner faces.")
    frame = np.array([ahead, np.cross([0.0, 0.0, 1.0], ahead), [0.0, 0.0, 1.0]])
    fused = fuse(g)
    t = wrench.time_s[used]
    settled = settled_samples_of(t)
    moved = [((fuse(g + SHIFT_M * u) - fused)[settled] @ u).mean() / SHIFT_M for u in frame]
    flying = np.linalg.norm(total.force_n[settled], axis=1) <= AXIS_THRESHOLD_N
    return FusedRun(
        person=path.parent.name,
        speed_m_s=int(path.stem.rpartition("_")[2]),
        mass_kg=walk.mass_kg,
        time_s=t,
        offset_m=(fused - g) @ frame.T,
        left_over=np.array(moved),
        aloft=float(flying.mean()),
    )


def _mean(runs: Sequence[FusedRun], value: Callable[[FusedRun], float]) -> float:
    return float(np.mean([value(one) for one in runs]))


def _size_claims(runs: Sequence[FusedRun]) -> list[Claim]:
    """How far the estimate lies from the geometry."""
    claims = []
    for k, (axis, key) in enumerate(zip(AXES, ("along", "left", "up"), strict=True)):
        sizes = [abs(float(one.mean_m[k])) for one in runs]
        claims.append(
            Measured(f"offset_{key}_m", "few centimeters", float(np.mean(sizes)), "m", within(*FEW_M, "ours")).says(
                f"there is a difference of few centimeters for each dimension ({axis})",
                "Mean over people of the size of the mean offset.",
                n=len(runs),
                interval=interval_of(sizes),
            )
        )
    return claims


def _constancy_claims(by_speed: dict[int, list[FusedRun]]) -> list[Claim]:
    """Whether the offset is that of a body table: the same later in the run, and at every speed."""
    runs = by_speed[LIKE_THESIS]
    drifts = [float(np.abs(one.drift_m).max()) for one in runs]
    slow, fast = ({one.person: one for one in by_speed[speed]} for speed in (SPEEDS[0], SPEEDS[-1]))
    people = sorted(slow.keys() & fast.keys())
    claims = [
        Measured("drift_m", "stable", float(np.mean(drifts)), "m", at_most(SAME_M, "ours")).says(
            "the difference converges after 1.5 s to a value and seems stable after",
            "Change of the offset from the first to the second half of what is left of the run without its first and "
            f"last {SETTLED_S} s "
            f"({_mean(runs, lambda one: float(one.settled_samples.mean() * np.ptp(one.time_s))):.1f} s on average), "
            "largest axis.",
            n=len(runs),
            interval=interval_of(drifts),
        )
    ]
    for k, (axis, key) in enumerate(zip(AXES, ("along", "left", "up"), strict=True)):
        changes = [abs(float(fast[person].mean_m[k] - slow[person].mean_m[k])) for person in people]
        spread = float(np.std([one.mean_m[k] for one in slow.values()], ddof=1)) if len(slow) > 1 else float("nan")
        claims.append(
            Measured(f"change_{key}_m", 0.0, float(np.mean(changes)), "m", at_most(SAME_M, "ours")).says(
                f"our method succeeded to correct a bias due to anthropometric table ({axis}): the offset is the same "
                f"at {SPEEDS[0]} and {SPEEDS[-1]} m/s",
                f"Mean size of the change; between people the standard deviation is {1e3 * spread:.1f} mm.",
                n=len(people),
                interval=interval_of(changes),
            )
        )
    return claims


def _rule_claims(runs: Sequence[FusedRun]) -> list[Claim]:
    """What the rule of 2.6.2 leaves of a bias that is added to the geometry of real runs."""
    people = sorted({one.person for one in runs})

    def of_people(value: Callable[[FusedRun], float]) -> list[float]:
        return [_mean([one for one in runs if one.person == person], value) for person in people]

    flat, up = of_people(lambda one: float(one.left_over[:2].max())), of_people(lambda one: float(one.left_over[2]))
    apart = of_people(lambda one: abs(float(one.left_over[:2].mean()) - one.aloft))
    note = f"{1e3 * SHIFT_M:.0f} mm are added to the geometry of every run; the forces and flights are the people's."
    return [
        Measured("bias_left", "corrects", float(np.mean(flat)), "1", at_most(0.5, "ours")).says(
            "the filter corrects a bias of the table, 30 mm injected into people's geometry (share that remains, worse "
            "horizontal axis)",
            note,
            interval=interval_of(flat),
        ),
        Measured("vertical_left", "corrects", float(np.mean(up)), "1", at_most(0.5, "ours")).says(
            "the filter corrects a bias of the table for each dimension, 30 mm injected into people's geometry (share "
            "that remains vertically)",
            "The position along the mean force is not observable (2.3.1).",
            interval=interval_of(up),
        ),
        target("bias_left_predicted", float(np.mean(apart)), "1", at_most=0.03).says(
            "the share that remains horizontally is the share of time in flight (difference)",
            "In flight c_p is set to the geometry with its bias.",
            interval=interval_of(apart),
        ),
    ]


def _offset_table(by_speed: dict[int, list[FusedRun]]) -> dict[str, Column]:
    """Mean offset and its standard deviation between people, per speed."""
    rows = []
    for speed, runs in by_speed.items():
        if len(runs) < 2:
            continue
        means = np.array([one.mean_m for one in runs])
        row: dict[str, object] = {"speed_m_s": speed, "n": len(runs)}
        for k, key in enumerate(("along", "left", "up")):
            row |= {f"{key}_m": float(means[:, k].mean()), f"{key}_sd_m": float(means[:, k].std(ddof=1))}
        rows.append({**row, "in_flight": _mean(runs, lambda one: one.aloft),
                     "bias_left": _mean(runs, lambda one: float(one.left_over[:2].mean()))})  # fmt: skip
    return as_columns(rows)


def _run_row(one: FusedRun) -> dict[str, object]:
    along, left, up = one.mean_m.tolist()
    return {"person": one.person, "speed_m_s": one.speed_m_s, "along_m": along, "left_m": left, "up_m": up}
