"""Estimators on recorded walks: consistency with physics, since the true CoM is unknown.

Adults walk at a comfortable (C4) and a fast speed (C5) over two plates (Schreiber and Moissenet 2019). Children and
adolescents walk and stand still on a plate, which gives the error of their segment table: the mean centre of pressure
lies below the CoM. No recording contains flight phases.

The geometry alone is the baseline of every claim. A mean compares the same walks for all estimators: those on which
each of them has the score. Residuals of the force that an estimator was given are not shown: following it makes them
small.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, PerAxis, Points, Progress, Vector3
from stridelab.errors import NotFound
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.comparison import Assessment, ComparisonData, compare
from stridelab.estimation.evaluation.force_path import PlateErrors, path_error
from stridelab.estimation.evaluation.truth_errors import BAND_95
from stridelab.estimation.kalman.filter import KalmanFilter, RtsSmoother
from stridelab.estimation.latency import estimate_latency
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.smoother import Smoother
from stridelab.recordings.marker_sets import identify
from stridelab.recordings.reader import read_recording
from stridelab.reproduction.claims import Claim, Reproduction, target
from stridelab.reproduction.common.estimator_errors import as_columns, rms
from stridelab.reproduction.common.estimators import AUTO, GEOMETRY, KALMAN, RTS, SMOOTHER, THESIS, TUNED
from stridelab.reproduction.common.intervals import interval_of, rms_ratio
from stridelab.reproduction.common.recorded_walks import (
    STATICS,
    LeftOut,
    RecordedWalk,
    geometric_com_of,
    left_out_text,
    read_some,
)
from stridelab.reproduction.report.svg_plots import Bars, render_svg

NAME: Final = "real-walks"
TITLE: Final = "People, against physics"
PRINTED: Final = ("agreement", "standing")
CHILDREN: Final = "children"
GROUPS: Final[Mapping[str, str]] = {
    "adults, comfortable": "rehazenter-adult-walking/*/*_C4_*.c3d",
    "adults, fast": "rehazenter-adult-walking/*/*_C5_*.c3d",
    CHILDREN: "biomechzoo-sample-study/*/Straight*.c3d",
}
ESTIMATORS: Final[Mapping[str, ComEstimator]] = {
    GEOMETRY: GeometryOnly(),
    THESIS: ComplementaryFilter.thesis(),
    AUTO: ComplementaryFilter(),
    KALMAN: KalmanFilter(),
    TUNED: KalmanFilter.tuned(),
    RTS: RtsSmoother.tuned(),
    SMOOTHER: Smoother(),
}
WALK, SIDE, UP = range(3)
Rows = Sequence[Mapping[str, object]]
LATENCY_S: Final = {
    "adults, comfortable": (0.014, 0.022),
    "adults, fast": (0.014, 0.022),
    CHILDREN: (0.008, 0.014),
}
"""Ranges of the median latency from independent evidence: growth of the offset with speed, likelihood of the smoother,
correlations."""
MAX_CHANGE_M: Final = 0.0025


@dataclass(frozen=True)
class AssessedWalk:
    """One recording: assessment of every estimator, mean squares of its distance from the force path, refusals.

    ``refused`` maps estimators to the code of their error; ``mass_kg`` is that of the plates where they show it.
    """

    name: str
    person: str
    assessments: Mapping[str, Assessment]
    path_m2: Mapping[str, PerAxis]
    refused: Mapping[str, str]
    mass_kg: float
    latency_s: float

    @property
    def held_back(self) -> Mapping[str, PerAxis]:
        """Residual at withheld force over body weight, of the estimators that half of the force was enough for."""
        weight_n = self.mass_kg * GRAVITY_M_S2
        return {k: a.held_back_n / weight_n for k, a in self.assessments.items() if a.held_back_n is not None}


def run(gait: Path, tell: Progress, seed: int = 0) -> Reproduction:
    """All walks below the folder ``gait`` that can be used; the note names groups that have none.

    ``seed`` draws the errors of plates from which the error of a path is computed.

    Raises ``NotFound`` (``recordings-missing``) if all have none.
    """
    walks: dict[str, list[AssessedWalk]] = {}
    left_out: list[LeftOut] = []
    missing: list[str] = []
    for k, (group, pattern) in enumerate(GROUPS.items()):
        tell(k / (len(GROUPS) + 1), group)
        try:
            walks[group], unused = read_some(gait, pattern, partial(_assess_walk, seed))
        except NotFound as error:
            missing.append(f"{group} ({error.message.rstrip('.')})")
            continue
        left_out += unused
    if not walks:
        raise NotFound("recordings-missing", f"No walks of {', nor of '.join(missing)}.")
    tell(len(GROUPS) / (len(GROUPS) + 1), "standing")
    absent = f" Missing: {'; '.join(missing)}." if missing else ""
    children = walks.get(CHILDREN, [])
    truth = {w.person: _table_error_m(gait / "biomechzoo-sample-study" / w.person) for w in children}
    rows = [
        {"walks": group, "estimator": name, **_mean_agreement(name, of_group)}
        for group, of_group in walks.items()
        for name in ESTIMATORS
    ]
    still = [_standing_distance_m(gait / "biomechzoo-sample-study" / w.person) for w in children]
    standing: list[dict[str, object]] = [
        {
            **_standing_comparison(name, children, truth),
            "still_m": rms([off[name] for off in still if name in off]),
        }
        for name in (ESTIMATORS if children else ())
    ]
    tell(1.0, "done")
    return Reproduction(
        claims=tuple(_walk_claims(walks, truth)),
        note="Default priors; the latency estimated in each recording is corrected, and the children's mass is that of "
        "the plates on which they stand. Per axis: along the walk (x), lateral (y), vertical (z). n: walks that the "
        "estimator accepts. Path: RMS distance from the path of the force, with the penalty for sharing its errors "
        "(docs/theory/judging-estimators.md), over people, on walks that all accept. Held back: RMS of m (c'' - g) - f "
        "below 8 Hz over body weight at samples whose force was withheld, on the walks (n held) on which all "
        "estimators have it. Offset: estimate minus geometry. Standing: difference between the table's bias "
        "estimated while walking and that of the same subject standing (miss), and distance of the standing "
        "subject's CoM from the mean centre of pressure (still). Intervals: bootstrap over people. These recordings "
        f"contain no flight phases; they are in the item flight. {_refusals(walks)}{left_out_text(left_out)}"
        f"{absent}",
        tables={
            "agreement": as_columns(rows),
            "standing": as_columns(standing) if standing else {"estimator": np.array([], dtype=str)},
        },
        drawing=render_svg(
            *(
                Bars(
                    f"Distance from the force path along the walk, {group}",
                    "mm",
                    [
                        (str(row["estimator"]), 1e3 * float(str(row["path_x_m"])))
                        for row in rows
                        if row["walks"] == group
                    ],
                )
                for group in walks
            )
        ),
        references=("carpentier2017thesis", "dumas2007"),
    ).with_basis("people", len(children or next(iter(walks.values()))))


def _assess_walk(seed: int, path: Path) -> AssessedWalk:
    walk = RecordedWalk.from_file(path)
    mass_kg = _standing_mass_kg(path.parent) or walk.mass_kg
    latency = estimate_latency(walk.geometric, walk.total_wrench, mass_kg)
    applied_s = latency.latency_s if latency.significant else 0.0
    wrench = walk.total_wrench(applied_s)
    comparison = compare(ESTIMATORS, ComparisonData(walk.geometric, wrench, mass_kg))
    errors = PlateErrors(clock_s=latency.sd_s)
    return AssessedWalk(
        name=path.name,
        person=walk.person,
        assessments=comparison.assessments,
        path_m2={
            name: path_error(ESTIMATORS[name], walk.geometric, wrench, mass_kg, errors, seed=seed).square_m2
            for name in comparison.assessments
        },
        refused={name: error.code for name, error in comparison.failures.items()},
        mass_kg=mass_kg,
        latency_s=applied_s,
    )


def _standing_mass_kg(folder: Path) -> float | None:
    """Mass of a subject who stands still on plates; None without such a recording."""
    for path in folder.glob(STATICS[1]):
        plates = read_recording(path).plates
        return float(sum(plate.force_n[:, 2].mean() for plate in plates) / GRAVITY_M_S2) if plates else None
    return None


def _refusals(walks: Mapping[str, Sequence[AssessedWalk]]) -> str:
    """Which walks are missing for which estimators, and why."""
    every = [walk for of_group in walks.values() for walk in of_group]
    no_estimate = [f"{name} on {walk.name} ({code})" for walk in every for name, code in walk.refused.items()]
    no_held = [f"{name} on {walk.name}" for walk in every for name in walk.assessments if name not in walk.held_back]
    return (
        f"No estimate: {', '.join(no_estimate) or 'none is missing'}. "
        f"Half of the force is not enough: {', '.join(no_held) or 'for none'}."
    )


def _table_error_m(folder: Path) -> Vector3:
    """Geometric CoM minus mean centre of pressure of a subject standing on plates: forward and to the left."""
    (path,) = folder.glob(STATICS[1])
    recording = read_recording(path)
    marked = identify(list(recording.markers_m)).landmarks
    at = {k: np.nanmean(recording.markers_m[marked[k]], axis=0) for k in ("l_asis", "r_asis", "sacrum")}
    f = np.sum([plate.force_n.mean(axis=0) for plate in recording.plates], axis=0)
    nu = np.sum([plate.moment_nm.mean(axis=0) for plate in recording.plates], axis=0)
    pressure = np.array([-nu[1], nu[0], 0.0]) / f[2]
    ahead = (at["l_asis"] + at["r_asis"]) / 2 - at["sacrum"]
    off = np.nanmean(geometric_com_of(recording, folder).com_m, axis=0) - pressure
    return np.asarray(walk_frame(ahead[None]) @ off * [1.0, 1.0, 0.0])


def _standing_distance_m(folder: Path) -> dict[str, float]:
    """Horizontal distance between CoM and mean centre of pressure of a standing subject, per estimator."""
    (path,) = folder.glob(STATICS[1])
    still = RecordedWalk.from_file(path)
    floor_m = float(np.mean([plate.corners_m[:, 2].mean() for plate in still.recording.plates if plate.use]))
    comparison = compare(
        ESTIMATORS, ComparisonData(still.geometric, still.total_wrench(0.0), still.mass_kg, floor_height_m=floor_m)
    )
    return {name: a.standing.horizontal_m for name, a in comparison.assessments.items() if a.standing is not None}


def _mean_agreement(name: str, walks: Sequence[AssessedWalk]) -> dict[str, object]:
    """Means of one estimator over the walks of a group, on those that all estimators share."""
    own = [w.assessments[name] for w in walks if name in w.assessments]
    held = [w.held_back[name] for w in walks if w.held_back.keys() == ESTIMATORS.keys()]
    path_m = np.sqrt(np.maximum(np.mean(list(_path_by_person(name, walks).values()), axis=0), 0.0))
    held_back = np.mean(held, axis=0) if held else np.full(3, np.nan)
    offset = np.mean([a.offset_m for a in own], axis=0)
    return {
        "n": len(own),
        **{f"path_{axis}_m": float(value) for axis, value in zip("xyz", path_m, strict=True)},
        "n_held": len(held),
        **{f"held_back_{axis}": float(value) for axis, value in zip("xyz", held_back, strict=True)},
        "offset_x_m": float(offset[WALK]),
        "offset_y_m": float(offset[SIDE]),
    }


def _path_by_person(name: str, walks: Sequence[AssessedWalk]) -> dict[str, PerAxis]:
    """Mean square distance from the force path of every person, on walks that all estimators accept."""
    of_person: dict[str, list[PerAxis]] = {}
    for walk in walks:
        if walk.path_m2.keys() == ESTIMATORS.keys():
            of_person.setdefault(walk.person, []).append(walk.path_m2[name])
    return {person: np.mean(squares, axis=0) for person, squares in of_person.items()}


def rms_of(squares: Sequence[float]) -> float:
    """Root of the mean of squares that a penalty may make negative."""
    return float(np.sqrt(max(float(np.mean(squares)), 0.0)))


def _standing_misses(name: str, walks: Sequence[AssessedWalk], truth: Mapping[str, Vector3]) -> Points:
    """Table error estimated while walking minus that of the same subject standing, a row per walk that all accept."""
    shared = [w for w in walks if w.assessments.keys() == ESTIMATORS.keys()]
    return np.array([-w.assessments[name].offset_m - truth[w.person] for w in shared]).reshape(-1, 3)


def _standing_comparison(name: str, walks: Sequence[AssessedWalk], truth: Mapping[str, Vector3]) -> dict[str, object]:
    """``_standing_misses`` of one estimator in numbers."""
    assessed = [w for w in walks if w.assessments.keys() == ESTIMATORS.keys()]
    miss = _standing_misses(name, walks, truth)
    sd = np.array([_sd_in_walk_m(w.assessments[name].estimate) for w in assessed])
    x, y, _ = np.sqrt(np.mean(miss**2, axis=0)).tolist()
    return {
        "estimator": name,
        "n": len(assessed),
        "miss_x_m": x,
        "miss_y_m": y,
        "mean_miss_x_m": float(miss[:, WALK].mean()),
        "largest_miss_x_m": float(np.abs(miss[:, WALK]).max()),
        "inside_the_band": float((np.abs(miss[:, :UP]) <= BAND_95 * sd[:, :UP]).mean()),
    }


def _sd_in_walk_m(estimate: ComEstimate) -> Vector3:
    """Mean standard deviation transformed from laboratory axes to: along the walk, to the left and up."""
    variance = np.mean(estimate.sd_m**2, axis=0)
    return np.asarray(np.sqrt(walk_frame(estimate.velocity_m_s) ** 2 @ variance))


def _walk_claims(
    walks: Mapping[str, Sequence[AssessedWalk]],
    truth: Mapping[str, Vector3],
) -> list[Claim]:
    claims = []
    for group, of_group in walks.items():
        path = {name: _path_by_person(name, of_group) for name in (SMOOTHER, GEOMETRY)}
        for axis, words in ((WALK, "along the walk"), (SIDE, "lateral")):
            ours, base = ([float(m2[axis]) for m2 in path[name].values()] for name in (SMOOTHER, GEOMETRY))
            if not ours:
                continue
            ratio, interval = rms_ratio(ours, base)
            claims.append(
                target(f"{group} path {'xy'[axis]}", ratio, "1", at_most=1.0).says(
                    f"{group}: distance from the force path, {words}, over that of the geometry alone",
                    f"RMS {1e3 * rms_of(ours):.1f} mm, geometry {1e3 * rms_of(base):.1f} mm, with that of the path.",
                    n=len(ours),
                    interval=interval,
                    comparator="geometry",
                )
            )
    missed = {name: _standing_misses(name, walks.get(CHILDREN, ()), truth) for name in (SMOOTHER, GEOMETRY)}
    for axis, words in ((WALK, "along the walk"), (SIDE, "lateral")):
        if not len(missed[SMOOTHER]):
            continue
        ours, base = ((missed[name][:, axis] ** 2).tolist() for name in (SMOOTHER, GEOMETRY))
        ratio, interval = rms_ratio(ours, base)
        claims.append(
            target(f"standing_{'xy'[axis]}", ratio, "1", at_most=1.0).says(
                f"the table's bias found while walking minus the subject's standing, {words}, over the bias itself",
                f"RMS {1e3 * rms_of(ours):.1f} mm, geometry {1e3 * rms_of(base):.1f} mm.",
                n=len(ours),
                interval=interval,
                comparator="geometry",
            )
        )
    slow, fast = ({w.person: w for w in walks.get(group, ())} for group in ("adults, comfortable", "adults, fast"))
    both = sorted(slow.keys() & fast.keys())
    for name in (SMOOTHER, AUTO):
        change = [
            fast[p].assessments[name].offset_m[WALK] - slow[p].assessments[name].offset_m[WALK]
            for p in both
            if name in fast[p].assessments and name in slow[p].assessments
        ]
        if not change:
            continue
        mean, sd = float(np.mean(change)), float(np.std(change))
        claims.append(
            target(f"speed_{name}", abs(mean), "m", at_most=MAX_CHANGE_M).says(
                f"{name}: change of the fused offset along the walk from C4 to C5 (mean)",
                f"{1e3 * mean:+.1f} mm in {len(change)} subjects, standard deviation {1e3 * sd:.1f} mm. "
                "A force delayed by 18 ms would change it by speed times delay.",
                n=len(change),
                interval=interval_of(change, lambda chosen: abs(float(chosen.mean()))),
            )
        )
    for group, (low, high) in LATENCY_S.items():
        late_s = [w.latency_s for w in walks.get(group, ())]
        if not late_s:
            continue
        claims.append(
            target(f"{group} latency", float(np.median(late_s)), "s", at_least=low, at_most=high).says(
                f"{group}: median latency of the force",
                n=len(late_s),
                interval=interval_of(late_s, np.median),
            )
        )
    return claims
