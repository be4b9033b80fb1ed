"""Estimators on recorded walks: consistency with physics, since the true CoM is unknown.

Adults walk at a comfortable (C4) and a fast speed (C5) over two plates (Schreiber and Moissenet 2019). Children and
adolescents walk and stand still on a plate, which gives the error of their segment table: the mean centre of pressure
lies below the CoM. No recording contains flight phases.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2, Progress, Vector3
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.differentiation import walk_frame
from stridelab.estimation.estimator import ComEstimate, ComEstimator
from stridelab.estimation.evaluation.comparison import Assessment, ComparisonData, compare
from stridelab.estimation.evaluation.physics_residuals import force_residual_track_n
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
from stridelab.reproduction.common.recorded_walks import STATICS, RecordedWalk, geometric_com_of, recordings_in
from stridelab.reproduction.report.svg_plots import Bars, render_svg

NAME: Final = "real-walks"
TITLE: Final = "People, against physics"
PRINTED: Final = ("agreement", "standing")
GROUPS: Final[Mapping[str, str]] = {
    "adults, comfortable": "rehazenter-adult-walking/*/*_C4_*.c3d",
    "adults, fast": "rehazenter-adult-walking/*/*_C5_*.c3d",
    "children": "biomechzoo-sample-study/*/Straight*.c3d",
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
    "children": (0.008, 0.014),
}
"""Ranges of the median latency from independent evidence: growth of the offset with speed, likelihood of the smoother,
correlations."""
MAX_RESIDUAL, MIN_CORRELATION, MAX_MISS_M, MAX_CHANGE_M = 0.01, 0.93, 0.006, 0.0025


@dataclass(frozen=True)
class AssessedWalk:
    """One recording: assessment of every estimator, and the corrected latency.

    ``constant_share`` is the mean of the smoother's force residual over body weight, in world axes.
    """

    person: str
    assessments: Mapping[str, Assessment]
    mass_kg: float
    latency_s: float
    constant_share: Vector3


def run(gait: Path, tell: Progress) -> Reproduction:
    """All walks below the folder ``gait``. Raises ``NotFound`` (``recordings-missing``) if there are none."""
    walks: dict[str, list[AssessedWalk]] = {}
    for k, (group, pattern) in enumerate(GROUPS.items()):
        tell(k / (len(GROUPS) + 1), group)
        walks[group] = [_assess_walk(RecordedWalk.from_file(path)) for path in recordings_in(gait, pattern)]
    tell(len(GROUPS) / (len(GROUPS) + 1), "standing")
    truth = {w.person: _table_error_m(gait / "biomechzoo-sample-study" / w.person) for w in walks["children"]}
    rows = [
        {
            "walks": group,
            "estimator": name,
            "n": len(of_group),
            **_mean_agreement([(w, w.assessments[name]) for w in of_group]),
        }
        for group, of_group in walks.items()
        for name in ESTIMATORS
        if all(name in w.assessments for w in of_group)
    ]
    still = [_standing_distance_m(gait / "biomechzoo-sample-study" / w.person) for w in walks["children"]]
    standing = [
        {
            **_standing_comparison(name, walks["children"], truth),
            "still_m": rms([off[name] for off in still if name in off]),
        }
        for name in ESTIMATORS
    ]
    tell(1.0, "done")
    return Reproduction(
        claims=tuple(_walk_claims(walks, rows, standing)),
        note="Default priors; the latency estimated in each recording is corrected. Per axis: along the walk (x), "
        "lateral (y), vertical (z); means over the recordings. Residual: RMS of m (c'' - g) - f below 8 Hz over body "
        "weight. Held back: the same at samples whose force was withheld from the estimator; the complementary filter "
        "uses the geometry's acceleration there. r: correlation of implied and segment L' about the lateral axis. "
        "The plates contradict the stated mass of some children by up to 9 %, which explains their vertical residual. "
        "Standing: difference between the table's bias estimated while walking and that of the same subject standing "
        "(miss), and distance of the standing subject's CoM from the mean centre of pressure (still). "
        "These recordings contain no flight phases; they are in the item flight.",
        tables={"agreement": as_columns(rows), "standing": as_columns(standing)},
        drawing=render_svg(
            *(
                Bars(
                    f"Force residual along the walk, {group}",
                    "% of body weight",
                    [
                        (str(row["estimator"]), 100.0 * float(str(row["residual_x"])))
                        for row in rows
                        if row["walks"] == group
                    ],
                )
                for group in GROUPS
            )
        ),
        references=("carpentier2017thesis", "dumas2007"),
    ).with_basis("people", len(walks["children"]))


def _assess_walk(walk: RecordedWalk) -> AssessedWalk:
    latency = estimate_latency(walk.geometric, walk.total_wrench, walk.mass_kg)
    applied_s = latency.latency_s if latency.significant else 0.0
    wrench = walk.total_wrench(applied_s)
    assessments = compare(ESTIMATORS, ComparisonData(walk.geometric, wrench, walk.mass_kg)).assessments
    residual = force_residual_track_n(assessments[SMOOTHER].estimate, wrench, walk.mass_kg)
    constant = np.nanmean(residual, axis=0) / (walk.mass_kg * GRAVITY_M_S2)
    return AssessedWalk(walk.person, assessments, walk.mass_kg, applied_s, np.asarray(constant))


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


def _mean_agreement(assessed: Sequence[tuple[AssessedWalk, Assessment]]) -> dict[str, float]:
    """Means over the walks of one estimator."""
    share = np.mean([a.residual_n / (w.mass_kg * GRAVITY_M_S2) for w, a in assessed], axis=0)
    held = [a.held_back_n / (w.mass_kg * GRAVITY_M_S2) for w, a in assessed if a.held_back_n is not None]
    x, y, z = share.tolist()
    held_x, held_y, held_z = np.mean(held, axis=0).tolist() if held else [float("nan")] * 3
    r = float(np.mean([a.momentum.correlation[SIDE] for _, a in assessed if a.momentum is not None]))
    offset = np.mean([a.offset_m for _, a in assessed], axis=0)
    return {
        "residual_x": x,
        "residual_y": y,
        "residual_z": z,
        "held_back_x": held_x,
        "held_back_y": held_y,
        "held_back_z": held_z,
        "r": r,
        "offset_x_m": float(offset[WALK]),
        "offset_y_m": float(offset[SIDE]),
    }


def _standing_comparison(name: str, walks: Sequence[AssessedWalk], truth: Mapping[str, Vector3]) -> dict[str, object]:
    """Difference between the table error estimated while walking and that of the same subject standing."""
    assessed = [w for w in walks if name in w.assessments]
    miss = np.array([-w.assessments[name].offset_m - truth[w.person] for w in assessed])
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
    rows: Sequence[Mapping[str, object]],
    standing: Sequence[Mapping[str, object]],
) -> list[Claim]:
    ours = {row["walks"]: row for row in rows if row["estimator"] == SMOOTHER}
    claims = []
    for group, row in ours.items():
        constant = np.mean([np.abs(w.constant_share) for w in walks[str(group)]], axis=0).tolist()
        claims += [
            target(f"{group} residual {axis}", float(str(row[f"residual_{axis}"])), "1", at_most=MAX_RESIDUAL).says(
                f"{group}: the smoother's force residual over body weight, {axis}",
                f"Constant part {constant[UP]:.4f}: plates against stated mass." if axis == "z" else "",
                n=len(walks[str(group)]),
            )
            for axis in "xyz"
        ]
        claims += [
            target(f"{group} momentum", float(str(row["r"])), "1", at_least=MIN_CORRELATION).says(
                f"{group}: correlation of implied and segment L' about the lateral axis",
                n=len(walks[str(group)]),
            ),
        ]
    still = next(row for row in standing if row["estimator"] == SMOOTHER)
    for axis, words in (("x", "along the walk"), ("y", "lateral")):
        claims.append(
            target(f"standing_{axis}", float(str(still[f"miss_{axis}_m"])), "m", at_most=MAX_MISS_M).says(
                f"the table's bias estimated while walking minus the same subject's standing, {words} (RMS)",
                f"{still['n']} subjects, table of Dumas.",
            )
        )
    slow, fast = ({w.person: w for w in walks[group]} for group in ("adults, comfortable", "adults, fast"))
    both = sorted(slow.keys() & fast.keys())
    for name in (SMOOTHER, AUTO):
        change = [
            fast[p].assessments[name].offset_m[WALK] - slow[p].assessments[name].offset_m[WALK]
            for p in both
            if name in fast[p].assessments and name in slow[p].assessments
        ]
        mean, sd = float(np.mean(change)), float(np.std(change))
        claims.append(
            target(f"speed_{name}", abs(mean), "m", at_most=MAX_CHANGE_M).says(
                f"{name}: change of the fused offset along the walk from C4 to C5 (mean)",
                f"{1e3 * mean:+.1f} mm in {len(change)} subjects, standard deviation {1e3 * sd:.1f} mm. "
                "A force delayed by 18 ms would change it by speed times delay.",
                n=len(change),
            )
        )
    late = {group: float(np.median([w.latency_s for w in of_group])) for group, of_group in walks.items()}
    for group, (low, high) in LATENCY_S.items():
        claims.append(
            target(f"{group} latency", late[group], "s", at_least=low, at_most=high).says(
                f"{group}: median latency of the force",
                n=len(walks[group]),
            )
        )
    return claims
