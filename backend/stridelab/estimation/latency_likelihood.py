"""Likelihood of each delay of the force, from the path of the CoM integrated from the force.

With D the double integral of f / m over the window, read tau later, and c_g the path of the segment model,

    c_g(t) - D(t; tau) = slow part + errors of the segment table + gain D + noise        in walking axes

is a linear regression at every tau. The slow part (start, speed, offsets of the plates: everything below 0.7 Hz) is
unconstrained and projected out. The other errors have priors: 20 % on each segment's mass (which moves the CoM by the
mass fraction times r_s - c) and on its lever along and across the segment, and 2 % on the mass that divides f. This
keeps the delay unbiased under table errors, which change the *phase* of the geometric path. The path is used instead of
the acceleration because its marker noise is white. The size and type (``_NOISES``) of the noise are those of the
highest likelihood at every tau. In cosine space (DCT) up to 8 Hz these are a few hundred equations for about 45
unknowns.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float
from scipy.fft import dct
from scipy.interpolate import CubicSpline

from stridelab.body.geometric_com import GeometricCom
from stridelab.conventions import Points, Rotation, Series
from stridelab.estimation.differentiation import BAND_HZ, Span
from stridelab.recordings.recording import WrenchTrack

SLOW_HZ: Final = 0.7
"""Lower end of the band: below it lie the drift of the plates and of the double integral, but no steps."""
TABLE_ERROR: Final = 0.2
GAIN_ERROR: Final = 0.02
_TABLE_HZ = 4.0
"""Above this the effect of table errors is smaller than the marker noise; it is faded out."""
_NOISE_HZ = (10.0, 20.0)
"""Band without segment motion; the power of a track in it is its white noise."""
_SIGMAS_M = np.geomspace(3e-4, 3e-2, 30)
"""Candidate standard deviations of the path's noise per sample; markers do not give a CoM better than 0.3 mm."""
_FLAT_BELOW_HZ = 0.5
_SEGMENT_JOINTS: Final[Mapping[str, tuple[str, str]]] = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "foot": ("ankle", "forefoot"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "hand": ("wrist", "knuckles"),
    "torso": ("cervical", "lumbar"),
    "head": ("cervical", "vertex"),
}
_LATERAL = 1

Lags = Float[np.ndarray, "lags"]
Columns = Float[np.ndarray, "rows columns"]
Paths = Float[np.ndarray, "rows lags"]
Spectra = Float[np.ndarray, "rows 3 lags"]
Weights = Float[np.ndarray, "3"]
Band = Bool[np.ndarray, "n"]


@dataclass(frozen=True)
class PathNoise:
    """Noise with a standard deviation proportional to frequency^``colour``, ``lateral`` times larger across the walk.

    ``min_sd_m`` is its smallest size; ``log_penalty`` is a penalty on the log-likelihood (a log prior) against noise
    models with weak support.
    """

    colour: float = 0.0
    lateral: float = 1.0
    min_sd_m: float = 0.0
    log_penalty: float = 0.0


_NOISES: Final = (
    PathNoise(),
    PathNoise(lateral=2.0, log_penalty=2.0),
    PathNoise(lateral=4.0, log_penalty=2.0),
    PathNoise(colour=1.0, min_sd_m=2e-3, log_penalty=6.0),
    PathNoise(colour=2.0, min_sd_m=2e-3, log_penalty=6.0),
)
"""White; larger across the walk, where real tables and plates have the largest errors; large at high frequencies."""


@dataclass(frozen=True)
class ClockLikelihood:
    """Log-likelihood at each lag (> 0: the force is late), at the likeliest noise.

    ``correlation`` is that of the force's path with the geometry's at the best lag, along and vertical together,
    without their slow parts and the likeliest errors of table and gain, which alone can lower it to 0.7 in a walk.
    """

    lag_s: Lags
    log_likelihood: Lags
    correlation: float


def clock_likelihood(
    geometric: GeometricCom, wrench: WrenchTrack, span: Span, mass_kg: float, R: Rotation, lag_s: Lags
) -> ClockLikelihood:
    """Likelihood of each lag, from the samples of the span whose force can be read at all lags.

    ``R`` has the walking axes as rows: along, across, up.
    """
    rate_hz = span.rate_hz
    spare = int(np.ceil(np.abs(lag_s).max() * rate_hz))
    core = slice(span.inside.start + spare, span.inside.stop - spare)
    at = geometric.time_s[core]
    f = wrench.force_n[span.inside]
    D = CubicSpline(geometric.time_s[span.inside], (f - f.mean(axis=0)) @ R.T / mass_kg).antiderivative(2)
    hz = np.arange(len(at)) * rate_hz / (2 * len(at))
    seen = hz <= BAND_HZ
    c = _cosine_spectrum(geometric.com_m[core] @ R.T)[seen]
    paths: Spectra = np.stack([_cosine_spectrum(np.asarray(D(at + tau)))[seen] for tau in lag_s], axis=-1)
    wrong = [TABLE_ERROR * _without_noise(x @ R.T, hz, seen) for x in _table_errors(geometric, core)]
    errors = np.stack([*wrong, GAIN_ERROR * paths[..., len(lag_s) // 2]], axis=-1)
    slow = _slow_columns(len(at), rate_hz)[seen]

    best: Lags = np.full(len(lag_s), -np.inf)
    for noise in _NOISES:
        weight = np.maximum(hz[seen], _FLAT_BELOW_HZ) ** -noise.colour
        weight = weight / np.exp(np.log(weight).mean())
        axes = noise.lateral ** (np.array([1.0, -2.0, 1.0]) / 3.0)
        keep = _orthogonal_complement(weight[:, None] * slow).T * weight
        y, made = (_project_paths(keep, x, axes) for x in (c[..., None] - paths, errors))
        best = np.maximum(best, _log_evidence(y, made, noise.min_sd_m) - noise.log_penalty)
    keep = _orthogonal_complement(slow).T
    path = keep @ paths[..., np.argmax(best)]
    geometry = keep @ c
    wrong_part = _likeliest_errors(geometry - path, np.tensordot(keep, errors, axes=1))
    return ClockLikelihood(lag_s, best, _path_correlation(geometry - wrong_part, path))


def _cosine_spectrum(x: Float[np.ndarray, "n *axes"]) -> Float[np.ndarray, "n *axes"]:
    return np.asarray(dct(x, axis=0, norm="ortho"))


def _project_paths(
    keep: Float[np.ndarray, "kept rows"], x: Float[np.ndarray, "rows 3 n"], axes: Weights
) -> Float[np.ndarray, "left n"]:
    """Each path without its slow part, in units of the noise."""
    return np.asarray((np.tensordot(keep, x, axes=1) * axes[:, None]).reshape(-1, x.shape[-1]))


def _log_evidence(y: Paths, errors: Columns, least_m: float) -> Lags:
    """Log p(y) of each column for ``errors`` with standard normal factors and white noise of the likeliest size."""
    return np.asarray(_evidence_of_sizes(y, errors, _SIGMAS_M[least_m <= _SIGMAS_M]).max(axis=0))


def _evidence_of_sizes(y: Paths, errors: Columns, sigmas_m: Float[np.ndarray, "sizes"]) -> Float[np.ndarray, "sizes n"]:
    """Log p(y) of each column, for white noise of each size."""
    U, s, _ = np.linalg.svd(errors, full_matrices=False)
    inside = (U.T @ y) ** 2
    outside = np.maximum((y**2).sum(axis=0) - inside.sum(axis=0), 0.0)
    rows = []
    for sigma in sigmas_m:
        variance = s**2 + sigma**2
        explained = (inside / variance[:, None]).sum(axis=0) + np.log(variance).sum()
        left = outside / sigma**2 + 2 * (len(y) - len(s)) * np.log(sigma)
        rows.append(-0.5 * (explained + left))
    return np.array(rows)


def _likeliest_errors(
    y: Float[np.ndarray, "kept 3"], errors: Float[np.ndarray, "kept 3 errors"]
) -> Float[np.ndarray, "kept 3"]:
    """The part of the difference of two paths that ``errors`` with standard normal factors most likely make up."""
    flat, columns = y.reshape(-1), errors.reshape(-1, errors.shape[-1])
    sigma_m = _SIGMAS_M[np.argmax(_evidence_of_sizes(flat[:, None], columns, _SIGMAS_M))]
    inverse_m2 = columns.T @ columns + sigma_m**2 * np.eye(columns.shape[1])
    return np.asarray(errors @ np.linalg.solve(inverse_m2, columns.T @ flat))


def _table_errors(geometric: GeometricCom, core: slice) -> list[Points]:
    """Displacements of the CoM if one segment's mass, or a component of its lever, were doubled."""
    c = geometric.com_m[core]
    moved = []
    for name, segment in geometric.segments.items():
        r = segment.com_m[core]
        moved.append(segment.mass_fraction * (r - c))
        ends = _segment_ends(geometric, name, core)
        if ends is not None:
            proximal, distal = ends
            n = (distal - proximal) / np.linalg.norm(distal - proximal, axis=1, keepdims=True)
            along = np.sum((r - proximal) * n, axis=1, keepdims=True) * n
            moved += [segment.mass_fraction * along, segment.mass_fraction * (r - proximal - along)]
    return [np.asarray(x) for x in moved if np.isfinite(x).all()]


def _segment_ends(geometric: GeometricCom, name: str, core: slice) -> tuple[Points, Points] | None:
    """Proximal and distal joint of a segment of the human model; None if unknown."""
    joints = geometric.joint_centres_m
    if name == "pelvis" and {"lumbar", "l_hip", "r_hip"} <= set(joints):
        return joints["lumbar"][core], (joints["l_hip"][core] + joints["r_hip"][core]) / 2
    side, part = (name[:2], name[2:]) if name[:2] in ("l_", "r_") else ("", name)
    if part not in _SEGMENT_JOINTS:
        return None
    proximal, distal = (side + end for end in _SEGMENT_JOINTS[part])
    return (joints[proximal][core], joints[distal][core]) if {proximal, distal} <= set(joints) else None


def _without_noise(x: Points, hz: Series, seen: Band) -> Float[np.ndarray, "rows 3"]:
    """Spectrum of a regressor, each line shrunk by its share of noise (Wiener filter).

    A noisy regressor would explain the noise that it shares with the CoM, and bias the delay.
    """
    spectrum = _cosine_spectrum(x)
    power, beyond = spectrum[seen] ** 2, (hz > _NOISE_HZ[0]) & (hz < _NOISE_HZ[1])
    noise = (spectrum[beyond] ** 2).mean(axis=0) if beyond.any() else np.zeros(3)
    fade = 1.0 / np.sqrt(1.0 + (hz[seen, None] / _TABLE_HZ) ** 8)
    return np.asarray(fade * spectrum[seen] * power / np.maximum(power + noise, 1e-30))


def _slow_columns(n: int, rate_hz: float) -> Columns:
    """Spectra of a parabola and of the cosines below ``SLOW_HZ``."""
    u = np.linspace(-1.0, 1.0, n)
    lines = [j for j in range(1, n) if j * rate_hz / (2 * n) < SLOW_HZ]
    cosines = [np.cos(np.pi * j * (np.arange(n) + 0.5) / n) for j in lines]
    return _cosine_spectrum(np.stack([np.ones(n), u, u**2, *cosines], axis=1))


def _orthogonal_complement(columns: Columns) -> Float[np.ndarray, "rows others"]:
    """Orthonormal basis of the orthogonal complement of the columns."""
    U, s, _ = np.linalg.svd(columns, full_matrices=True)
    return np.asarray(U[:, int(np.sum(s > 1e-9 * s[0])) :])


def _path_correlation(x: Points, y: Points) -> float:
    x, y = np.delete(x, _LATERAL, axis=1), np.delete(y, _LATERAL, axis=1)
    return float((x * y).sum() / max(float(np.linalg.norm(x) * np.linalg.norm(y)), 1e-12))
