"""The least error on tracks of real walks: of the linear estimator that knows every covariance.

The path is drawn from the acceleration's covariance over the walks of other people, the errors from the sizes with
which ``real_tracks.draw_inputs`` draws them, and all of it is Gaussian once the measurements are linear about the
truth. Then the posterior covariance is the error, without a draw. It knows the angular momentum of the segments without
error, and that a late force shows in all axes: with f late by d, the measured force lacks d f' and the moment
d (v x f + L'').
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline
from scipy.linalg import solve_triangular, toeplitz

from experiments.real_tracks import MARGIN_S, MARKERS_HZ, TURNS, ExactWalk, TrackErrors
from stridelab.conventions import GRAVITY_M_S2, Mask, PerAxis, Points
from stridelab.estimation.differentiation import low_pass, walk_frame
from stridelab.estimation.smoother import SmootherPriors
from stridelab.recordings.recording import Window

Clock = Literal["shared", "moments", "exact"]
"""A late force shows in every axis, as it does; only as a constant moment, as in the smoother; or is not late."""
Matrix = Float[np.ndarray, "rows columns"]
START_SD_M, START_SD_M_S, FILTERED_SD_M = 1.0, 2.0, 1e-5


@dataclass(frozen=True)
class Floor:
    """Mean squared error ahead and to the left over the longest window, and the posterior sd of the latency."""

    square_m2: Float[np.ndarray, "2"]
    clock_sd_s: float


def acceleration_covariance(others: Sequence[ExactWalk], n: int) -> Float[np.ndarray, "3 n"]:
    """Covariance of the acceleration at lags of 0 to n - 1 samples over walks, tapered so that it is one."""
    total, samples = np.zeros((3, n)), np.zeros(n)
    for walk in others:
        a = _walk_acceleration(walk)
        for lag in range(min(n, len(a))):
            total[:, lag] += np.sum(a[: len(a) - lag] * a[lag:], axis=0)
            samples[lag] += len(a)
    return np.asarray(total / np.maximum(samples, 1.0))


def least_error(walk: ExactWalk, errors: TrackErrors, covariance: Float[np.ndarray, "3 n"], clock: Clock) -> Floor:
    """Posterior covariance of the path. The unknowns: start, accelerations, the table's variation, constants."""
    sizes, t, n, weight_n = SmootherPriors(), walk.time_s, len(walk.time_s), walk.mass_kg * GRAVITY_M_S2
    frame = walk_frame(np.gradient(walk.com_m, t, axis=0))
    c, f, turn = (x @ frame.T for x in (walk.com_m, walk.force_n, walk.momentum_rate_nm))
    a = f / walk.mass_kg - np.array([0.0, 0.0, GRAVITY_M_S2])
    v = np.gradient(c, t, axis=0)
    jerk, turn_rate = (np.asarray(make_interp_spline(t, x, k=3)(t, 1)) for x in (a, turn))
    windows, seen = _loaded_windows(walk, errors)
    at = np.flatnonzero(seen)

    start, vary, constant = 6, 6 + 3 * n, 6 + 6 * n
    table, force, moment, late, mass, factor = (constant + k for k in (0, 3, 6, 8, 9, 10))
    prior = np.zeros((constant + 12, constant + 12))
    prior[range(6), range(6)] = [START_SD_M**2] * 3 + [START_SD_M_S**2] * 3
    slow = toeplitz(np.exp(-(t - t[0]) / sizes.table_varying_s))
    for k, share in enumerate((1.0, 1.0, 1.0 / 3.0)):
        _add_block(prior, start + k * n, _nearest_covariance(toeplitz(covariance[k])))
        _add_block(prior, vary + k * n, (share * sizes.table_varying_m) ** 2 * slow)
    _add_block(prior, table, frame @ np.diag(np.square(walk.sd_m)) @ frame.T)
    _add_block(prior, force, sizes.plate_force_n**2 * np.eye(3))
    along, lateral = (np.hypot(sizes.plate_moment_nm, errors.rolls * size) for size in sizes.walking_moment_nm)
    clock_m = sizes.clock_s * float(np.linalg.norm(v[:, :2].mean(axis=0))) * (clock == "moments")
    _add_block(prior, moment, np.diag([(along / weight_n) ** 2 + clock_m**2, (lateral / weight_n) ** 2]))
    prior[late, late] = sizes.clock_s**2 * (clock == "shared")
    prior[mass, mass] = sizes.mass_share**2
    _add_block(prior, factor, errors.rolls * np.diag([TURNS[1][1] ** 2, TURNS[0][1] ** 2]))

    twice = _twice_integrated(n, 1.0 / walk.rate_hz)
    paths = np.zeros((3, n, len(prior)))
    for k in range(3):
        paths[k, :, k], paths[k, :, 3 + k] = 1.0, t - t[0]
        paths[k, :, start + k * n : start + (k + 1) * n] = twice
    filtered = errors.markers == "filtered"
    seen_paths = low_pass(np.eye(n), walk.rate_hz, MARKERS_HZ) @ paths if filtered else paths.copy()
    forces, moments = np.zeros((3, len(at), len(prior))), np.zeros((2, len(at), len(prior)))
    for k in range(3):
        seen_paths[k, :, table + k] = 1.0
        seen_paths[k, range(n), vary + k * n + np.arange(n)] = 1.0
        forces[k, range(len(at)), start + k * n + at] = 1.0
        forces[k, :, late], forces[k, :, force + k] = -jerk[at, k], 1.0 / walk.mass_kg
        forces[k, :, mass] = -f[at, k] / walk.mass_kg
    late_moment = -(np.cross(v, f) + turn_rate)
    for k, (other, sign) in enumerate(((1, -1.0), (0, 1.0))):
        moments[k] = f[at, 2:] / weight_n * paths[k, at] - f[at, k : k + 1] / weight_n * paths[2, at]
        moments[k, :, moment + k], moments[k, :, force + k] = 1.0, c[at, 2] / weight_n
        moments[k, :, late] = sign * late_moment[at, other] / weight_n
        moments[k, :, factor + k] = sign * turn[at, other] / weight_n

    rows = np.concatenate([*seen_paths, *forces, *moments])
    lever = c[at, 2] / weight_n
    noise = np.diag(
        np.concatenate(
            [
                np.full(3 * n, (FILTERED_SD_M if filtered else sizes.marker_m) ** 2),
                np.full(3 * len(at), (sizes.force_n / walk.mass_kg) ** 2),
                np.tile((sizes.moment_nm / weight_n) ** 2 + (lever * sizes.force_n) ** 2, 2),
            ]
        )
    )
    for k in range(2):  # the noise of the force acts at the floor, too
        i, j = 3 * n + k * len(at) + np.arange(len(at)), 3 * n + (3 + k) * len(at) + np.arange(len(at))
        noise[i, j] = noise[j, i] = lever * sizes.force_n**2 / walk.mass_kg
    known = rows @ prior
    explained = solve_triangular(np.linalg.cholesky(known @ rows.T + noise), known, lower=True)
    longest = max(windows, key=lambda one: one.end_s - one.start_s)
    judged = (t >= longest.start_s - 1e-9) & (t <= longest.end_s + 1e-9)
    squares = [
        np.mean(np.sum((path @ prior) * path, axis=1) - np.sum((explained @ path.T) ** 2, axis=0))
        for path in paths[:2, judged]
    ]
    clock_m2 = prior[late, late] - np.sum(explained[:, late] ** 2)
    return Floor(np.array(squares), float(np.sqrt(max(clock_m2, 0.0))))


def _walk_acceleration(walk: ExactWalk) -> Points:
    frame = walk_frame(np.gradient(walk.com_m, walk.time_s, axis=0))
    gravity: PerAxis = np.array([0.0, 0.0, GRAVITY_M_S2])
    return np.asarray((walk.force_n / walk.mass_kg - gravity) @ frame.T)


def _loaded_windows(walk: ExactWalk, errors: TrackErrors) -> tuple[tuple[Window, ...], Mask]:
    t = walk.time_s
    whole = (Window(float(t[0] + MARGIN_S), float(t[-1] - MARGIN_S)),)
    windows = whole if errors.whole else walk.windows
    return windows, np.any([(t >= one.start_s - 1e-9) & (t <= one.end_s + 1e-9) for one in windows], axis=0)


def _add_block(into: Matrix, first: int, block: Float[np.ndarray, "block block"]) -> None:
    into[first : first + len(block), first : first + len(block)] = block


def _nearest_covariance(matrix: Matrix) -> Matrix:
    """The nearest covariance: lags that few walks have may leave small negative eigenvalues."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, 1e-8 * values.max())) @ vectors.T)


def _twice_integrated(n: int, dt: float) -> Matrix:
    """Positions of trapezoidal accelerations, from rest."""
    speed, path = np.zeros((n, n)), np.zeros((n, n))
    for k in range(1, n):
        speed[k], path[k] = speed[k - 1], path[k - 1] + dt * speed[k - 1]
        speed[k, k - 1 : k + 1] += dt / 2
        path[k, k - 1 : k + 1] += dt * dt / 4
    return path
