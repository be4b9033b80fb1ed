"""Proposes the landmark of each marker of a recording with unknown labels.

The evidence is of three kinds: the label itself, compared with the labels of the shipped marker sets and with words;
the mean position and the swing of the marker in a frame that moves with the body (``models/marker_positions.toml``);
and the distances to the markers of the same segment, which are constant. Size, heading and place of the body are
unknown, and chosen such that the cost of the best assignment is least.
"""

import tomllib
import warnings
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.optimize import linear_sum_assignment

from stridelab.machine.models_folder import models_dir
from stridelab.recordings.marker_sets import PAIRED, marker_sets, normalised_label
from stridelab.recordings.recording import Recording

Costs = Float[np.ndarray, "markers landmarks"]

_MAX_FRAMES: Final = 250
_MIN_VISIBLE: Final = 0.2
"""Minimum share of frames in which a marker must be visible to be assigned."""
_TURNS: Final = (0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi)
"""Errors of the heading that are tried: only the first two where the walking direction is known."""
_SIZES_M: Final = tuple(np.arange(0.55, 1.16, 0.04))
"""Height of the pelvis above the floor, from children to tall adults."""
_WALKING_SWING: Final = 0.15
"""Swing of the feet, in heights of the pelvis, above which the motion of the markers is compared."""
_MIDDLE_OF_ALL: Final = -0.08
"""Typical middle of all markers, forward of the ASIS in heights of the pelvis; the search begins there."""
_UNASSIGNED_COST: Final = 9.0
"""Cost of a marker without a landmark. Costs are of the size of squared deviations over variance."""
_LABEL_COST: Final = 14.0
_MIN_SIMILARITY: Final = 0.5
_RIGIDITY_COST: Final = 6.0
_RIGID_M: Final = 0.03
"""Standard deviation of a distance above which two markers are certainly not on one segment."""
_MARGIN_SCALE: Final = 2.0
_SEGMENTS: Final[Mapping[str, tuple[str, ...]]] = {
    "foot": ("heel", "toe", "mt1", "mt2", "mt5", "ankle_lateral", "ankle_medial"),
    "shank": (
        *("ankle_lateral", "ankle_medial", "knee_lateral", "knee_medial", "fibula_head", "tibial_tuberosity"),
        *("shank_t1", "shank_t2", "shank_t3"),
    ),
    "thigh": ("knee_lateral", "knee_medial", "trochanter", "thigh_t1", "thigh_t2", "thigh_t3"),
    "forearm": ("elbow_lateral", "elbow_medial", "wrist_radial", "wrist_ulnar", "forearm_t1"),
    "hand": ("wrist_radial", "wrist_ulnar", "mc2", "mc5"),
    "upper_arm": ("acromion", "elbow_lateral", "elbow_medial", "upper_arm_t1"),
    "pelvis": ("l_asis", "r_asis", "l_psis", "r_psis", "sacrum"),
    "trunk": ("c7", "t8", "t10", "t12", "jugular_notch", "xiphoid", "l_clavicle", "r_clavicle"),
    "head": (
        *("l_head_front", "r_head_front", "l_head_back", "r_head_back"),
        *("l_head_side", "r_head_side", "head_top"),
    ),
}
"""Landmarks at constant distances; names without a side stand for one segment of each side."""


@dataclass(frozen=True)
class MarkerFeatures:
    """Features of the markers of one recording.

    ``mean_m`` (n, 3): mean position forward, left and up, horizontally relative to the middle of all markers.
    ``swing_m`` (n, 2): standard deviation forward and up. ``rigidity_m`` (n, n): standard deviation of distances.
    """

    labels: tuple[str, ...]
    mean_m: Float[np.ndarray, "markers 3"]
    swing_m: Float[np.ndarray, "markers 2"]
    rigidity_m: Float[np.ndarray, "markers markers"]
    heading_known: bool


@dataclass(frozen=True)
class ProposedMarker:
    """Label proposed for a landmark; ``confidence`` (0 to 1) compares it with the best other assignment.

    ``likeness`` (0 to 1) is that of the label to the known ones of the landmark, ``misfit`` the cost of the marker's
    place, its motion, and its distances to the markers of its segment.
    """

    label: str
    confidence: float
    likeness: float
    misfit: float


@dataclass(frozen=True)
class _Statistics:
    """Positions of the landmarks, ``mean`` and ``sd`` as in the file, the cost of rare landmarks, and words."""

    names: tuple[str, ...]
    mean: Float[np.ndarray, "landmarks 5"]
    sd: Float[np.ndarray, "landmarks 5"]
    rarity: Float[np.ndarray, " landmarks"]
    words: tuple[frozenset[str], ...]
    segments: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class _Fit:
    """An assignment (marker to landmark) for one turn, size and place of the body, with its cost."""

    turn_rad: float
    size_m: float
    middle: tuple[float, float]
    costs: Costs
    pairs: Mapping[int, int]
    total: float


def propose_marker_map(recording: Recording) -> dict[str, ProposedMarker]:
    """Propose the label of each landmark of ``recording``; markers without a likely landmark are left out."""
    features = marker_features(recording)
    return propose_from_features(features) if len(features.labels) > 1 else {}


def propose_from_features(features: MarkerFeatures) -> dict[str, ProposedMarker]:
    """Propose the label of each landmark for at least two markers."""
    known = _landmark_statistics()
    word_costs = label_costs(features.labels)
    turns = _TURNS[:2] if features.heading_known else _TURNS
    starts = [_fit_place(features, word_costs, turn, size_m) for turn, size_m in product(turns, _SIZES_M)]
    refined = [_refine(features, word_costs, start) for start in sorted(starts, key=lambda fit: fit.total)[:3]]
    best = min(refined, key=lambda fit: fit.total)
    margins = _exchange_margins(best.costs, best.pairs)
    place_costs = best.costs - word_costs - known.rarity
    return {
        known.names[landmark]: ProposedMarker(
            features.labels[marker],
            confidence=float(1.0 / (1.0 + np.exp(-margins[marker] / _MARGIN_SCALE))),
            likeness=float(-word_costs[marker, landmark] / _LABEL_COST),
            misfit=float(place_costs[marker, landmark]),
        )
        for marker, landmark in sorted(best.pairs.items(), key=lambda pair: known.names[pair[1]])
    }


def marker_features(recording: Recording) -> MarkerFeatures:
    """Features of all markers that are visible often enough; empty if fewer than two are."""
    step = max(1, recording.n_frames // _MAX_FRAMES)
    tracks = {label: np.asarray(track[::step]) for label, track in recording.markers_m.items()}
    labels = tuple(label for label, track in tracks.items() if np.mean(~np.isnan(track[:, 0])) >= _MIN_VISIBLE)
    if len(labels) < 2:
        return MarkerFeatures((), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros((0, 0)), heading_known=False)
    points = np.stack([tracks[label] for label in labels], axis=1)  # frames, markers, xyz
    points = points[~np.isnan(points).all(axis=(1, 2))]
    points[:, :, :2] -= np.nanmedian(points[:, :, :2], axis=1, keepdims=True)
    if recording.walking_direction is not None:
        forward = np.asarray(recording.walking_direction[:2])
    else:  # the body is wider than deep
        forward = np.linalg.eigh(np.cov(np.nanmean(points[:, :, :2], axis=0).T))[1][:, 0]
    turn = np.array([[forward[0], forward[1], 0.0], [-forward[1], forward[0], 0.0], [0.0, 0.0, 1.0]])
    body = points @ turn.T
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of markers that are never visible together
        rigidity_m = np.nan_to_num(np.array([_distance_sd_m(points, marker) for marker in range(len(labels))]))
    return MarkerFeatures(
        labels=labels,
        mean_m=np.nanmean(body, axis=0),
        swing_m=np.nanstd(body[:, :, [0, 2]], axis=0),
        rigidity_m=rigidity_m,
        heading_known=recording.walking_direction is not None,
    )


def _distance_sd_m(points_m: Float[np.ndarray, "frames markers 3"], marker: int) -> Float[np.ndarray, " markers"]:
    """Standard deviation over time of the distances of one marker to all; NaN if two are never visible together."""
    return np.asarray(np.nanstd(np.linalg.norm(points_m - points_m[:, [marker]], axis=2), axis=0))


def label_costs(labels: Sequence[str]) -> Costs:
    """Cost (at most 0) of each label for each landmark, from its similarity to known labels and words."""
    known = _landmark_statistics()
    similarity = np.zeros((len(labels), len(known.names)))
    for row, label in enumerate(labels):
        for side, core in _sides_of_label(normalised_label(label)):
            pieces = _letter_pairs(core)
            for column, name in enumerate(known.names):
                if side == _side_of_landmark(name):
                    values = [_similarity(pieces, _letter_pairs(word)) for word in known.words[column]]
                    similarity[row, column] = max(similarity[row, column], *values)
    return -_LABEL_COST * np.clip((similarity - _MIN_SIMILARITY) / (1.0 - _MIN_SIMILARITY), 0.0, 1.0)


def _fit_place(
    features: MarkerFeatures, word_costs: Costs, turn_rad: float, size_m: float, before: _Fit | None = None
) -> _Fit:
    """Assign the markers for a turn and size; move the middle of the pelvis to where the assigned markers place it.

    ``before`` is an earlier assignment, whose segments then must be rigid.
    """
    known = _landmark_statistics()
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    horizontal = features.mean_m[:, :2] @ np.array([[c, s], [-s, c]]) / size_m
    swing = features.swing_m / size_m
    measured = np.column_stack([horizontal, features.mean_m[:, 2] / size_m, swing])
    used = np.array([1.0, 1.0, 1.0, 1.0, 1.0])
    if swing[:, 0].max() < _WALKING_SWING:
        used[3:] = 0.0
    fixed_costs = known.rarity + word_costs
    if before is None:
        middle = horizontal.mean(axis=0) - np.array([_MIDDLE_OF_ALL, 0.0])
    else:
        middle = np.array(before.middle)
        fixed_costs = fixed_costs + _RIGIDITY_COST * _rigidity_costs(features.rigidity_m, before.pairs)
    for _ in range(3):
        z = (measured[:, None, :] - np.concatenate([middle, np.zeros(3)]) - known.mean) / known.sd
        costs = (2.0 * np.log1p(z**2 / 4.0) * used).sum(axis=2) + fixed_costs  # of Student's t, for outliers
        pairs, total = _assign(costs)
        if not pairs:
            break
        markers, landmarks = np.array(list(pairs)), np.array(list(pairs.values()))
        weight = 1.0 / (known.sd[landmarks, :2] ** 2 * (1.0 + z[markers, landmarks, :2] ** 2 / 4.0))
        middle = (weight * (measured[markers, :2] - known.mean[landmarks, :2])).sum(axis=0) / weight.sum(axis=0)
    return _Fit(turn_rad, size_m, (float(middle[0]), float(middle[1])), costs, pairs, total)


def _refine(features: MarkerFeatures, word_costs: Costs, start: _Fit) -> _Fit:
    """Repeat the assignment with the rigidity of the segments, then with sizes near the first one."""
    fit = start
    for _ in range(3):
        fit = _fit_place(features, word_costs, fit.turn_rad, fit.size_m, fit)
    sizes = [fit.size_m * (1.0 + share) for share in (-0.03, -0.015, 0.015, 0.03)]
    near = [_fit_place(features, word_costs, fit.turn_rad, size_m, fit) for size_m in sizes]
    return min((fit, *near), key=lambda one: one.total)


def _assign(costs: Costs) -> tuple[dict[int, int], float]:
    """Assignment of least total cost, in which a marker without a landmark costs ``_UNASSIGNED_COST``."""
    n, n_landmarks = costs.shape
    padded = np.hstack([costs, np.full((n, n), _UNASSIGNED_COST)])
    rows, columns = linear_sum_assignment(padded)
    pairs = {int(m): int(k) for m, k in zip(rows, columns, strict=True) if k < n_landmarks}
    return pairs, float(padded[rows, columns].sum())


def _rigidity_costs(rigidity_m: np.ndarray, pairs: Mapping[int, int]) -> Costs:
    """Share of the other markers on the landmark's segments whose distance to a marker is not constant."""
    known = _landmark_statistics()
    marker_of = {landmark: marker for marker, landmark in pairs.items()}
    n = len(rigidity_m)
    moving = np.minimum(rigidity_m / _RIGID_M, 1.0)
    sums, counts = np.zeros((n, len(known.names))), np.zeros((n, len(known.names)))
    for members in known.segments:
        mates = [marker_of[k] for k in members if k in marker_of]
        count = np.full(n, float(len(mates)))
        count[mates] -= 1.0  # without itself, to which its distance is 0
        sums[:, members] += moving[:, mates].sum(axis=1)[:, None]
        counts[:, members] += count[:, None]
    return sums / np.maximum(counts, 1.0)


def _exchange_margins(costs: Costs, pairs: Mapping[int, int]) -> dict[int, float]:
    """Least increase of the total cost if a marker gets no landmark or a free one, or is exchanged with another."""
    n = len(costs)
    own = np.array([costs[m, pairs[m]] if m in pairs else _UNASSIGNED_COST for m in range(n)])
    margins = {}
    for marker, landmark in pairs.items():
        taken = np.array([costs[marker, pairs[m]] if m in pairs else _UNASSIGNED_COST for m in range(n)])
        exchanged = np.delete(taken + costs[:, landmark] - own[marker] - own, marker)
        free = np.delete(costs[marker], list(pairs.values()))
        margins[marker] = float(min(_UNASSIGNED_COST - own[marker], *(free - own[marker]), *exchanged))
    return margins


def _sides_of_label(label: str) -> set[tuple[str, str]]:
    """Possible readings of a normalised label as a side ("l", "r" or "") and the rest."""
    readings = {("", label)}
    for word, side in (("left", "l"), ("right", "r"), ("l", "l"), ("r", "r")):
        if label.startswith(word):
            readings.add((side, label[len(word) :]))
        if label.endswith(word):
            readings.add((side, label[: -len(word)]))
    return {(side, rest) for side, rest in readings if len(rest) > 1}


def _side_of_landmark(name: str) -> str:
    return name[0] if name[:2] in {"l_", "r_"} else ""


@cache
def _letter_pairs(word: str) -> frozenset[str]:
    bounded = f"^{word}$"
    return frozenset(bounded[k : k + 2] for k in range(len(bounded) - 1))


def _similarity(one: frozenset[str], other: frozenset[str]) -> float:
    """Dice coefficient of two sets of letter pairs."""
    return 2.0 * len(one & other) / (len(one) + len(other))


@cache
def _landmark_statistics() -> _Statistics:
    entries = tomllib.loads((models_dir() / "marker_positions.toml").read_text(encoding="utf-8"))
    shipped: defaultdict[str, set[str]] = defaultdict(set)
    for known in marker_sets().values():
        for landmark, labels in known.labels.items():
            side = _side_of_landmark(landmark)
            shipped[landmark] |= {rest for label in labels for s, rest in _sides_of_label(label) if s == side}
    names, mean, sd, rarity, words = [], [], [], [], []
    for name, entry in entries.items():
        paired = name in PAIRED or name[-3:-1] == "_t"
        for side, sign in (("l_", 1.0), ("r_", -1.0)) if paired else (("", 1.0),):
            x, y, z, swing, lift = entry["mean"]
            names.append(side + name)
            mean.append((x, sign * y, z, swing, lift))
            sd.append(entry["sd"])
            rarity.append(-np.log(entry["share"]))
            words.append(frozenset(entry["words"]) | shipped[side + name])
    members = [
        [name if name in names else side + name for name in segment]
        for segment in _SEGMENTS.values()
        for side in (("",) if segment[0] in names else ("l_", "r_"))
    ]
    segments = tuple(tuple(names.index(name) for name in segment) for segment in members)
    return _Statistics(tuple(names), np.array(mean), np.array(sd), np.array(rarity), tuple(words), segments)
