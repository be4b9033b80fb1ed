"""Points of a scanned terrain: thinned, without lonely points, with local normals and an estimate of the noise.

A mesh is sampled densely on its triangles, so that both are treated alike.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from stridelab.contacts.terrain_meshes.reading import TerrainMesh
from stridelab.conventions import Mask, Points, Series

MAX_SAMPLES: Final = 200_000
MESH_SPACING_M: Final = 0.01
FINEST_M: Final = 0.005
COARSER: Final = 1.3
NORMAL_RADIUS_M: Final = 0.06
NEIGHBOURS: Final = (12, 60)
"""Least and most neighbours of a local plane."""
LONELY: Final = 3.0
"""Distance of the eighth neighbour, in typical ones, from which on a point is an outlier."""
NOISE_SHARE: Final = 0.3
"""Share of the points whose local planes are thinner than the noise; those at edges are thicker."""
BRIDGED_M: Final = 0.05
"""Radius of holes in clouds below which nothing is seen that count as surface: a sole is 20 cm long."""
CHUNK: Final = 20_000
BRIDGED_SPACINGS: Final = 2.5
"""The same in spacings: random points leave such holes where there are none."""
MESH_BRIDGED_M: Final = 0.02
"""The same of meshes, whose triangles leave no holes but by noise."""
MESH_NOISE: Final = 1.4
"""Noise of the vertices of triangles over that of points on them, which are means of three."""
Thinned = Float[np.ndarray, "k 3"]


@dataclass(frozen=True, eq=False)
class Samples:
    """Points with unit normals (upwards), distances from their local plane (rms), their spacing and their noise.

    ``gap_m`` is the radius of holes between the points that are surface, too.
    """

    points_m: Points
    normals: Points
    roughness_m: Series
    spacing_m: float
    noise_m: float
    gap_m: float


def sample_triangles(mesh: TerrainMesh, chosen: Mask) -> Thinned:
    """Points on the chosen triangles, about a centimetre apart, further if they were too many."""
    corners_m = mesh.vertices_m[mesh.triangles[chosen]]
    areas = 0.5 * np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    edges_m = np.linalg.norm(np.roll(corners_m, -1, axis=1) - corners_m, axis=2).max(axis=1)
    total_m2 = float(np.linalg.norm(areas, axis=1).sum())
    spacing_m = max(MESH_SPACING_M, float(np.sqrt(total_m2 / (2.0 * MAX_SAMPLES))))
    parts = np.clip(np.ceil(edges_m / spacing_m).astype(int), 1, 2_000)
    points: list[Points] = []
    for n in np.unique(parts):
        i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
        weights = np.column_stack([i, j, n - i - j])[i + j <= n] / n
        groups = np.array_split(corners_m[parts == n], 1 + (parts == n).sum() * len(weights) // 1_000_000)
        points += [
            thin_points(np.einsum("kc,tcx->tkx", weights, group).reshape(-1, 3), 0.8 * spacing_m) for group in groups
        ]
    return thin_points(np.concatenate([np.zeros((0, 3)), *points]), 0.8 * spacing_m)


def thin_points(points_m: Points, edge_m: float) -> Thinned:
    """One point, the mean of all, in every cube of a grid."""
    if len(points_m) == 0:
        return points_m
    cubes = np.floor((points_m - points_m.min(axis=0)) / edge_m).astype(np.int64)
    keys = cubes @ (1 << np.array([0, 21, 42], dtype=np.int64))
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    inverse = inverse.reshape(-1)
    sums = [np.bincount(inverse, weights=points_m[:, k], minlength=len(counts)) for k in range(3)]
    return np.column_stack(sums) / counts[:, None]


def prepare_samples(points_m: Points, *, from_mesh: bool = False) -> Samples | None:
    """Thin points to ``MAX_SAMPLES``, leave out lonely ones, and fit local planes; None for fewer than 50."""
    edge_m = FINEST_M
    while len(points_m) > MAX_SAMPLES:
        points_m = thin_points(points_m, edge_m)
        edge_m *= COARSER
    if len(points_m) < 50:
        return None
    tree = cKDTree(points_m)
    eighth_m = tree.query(points_m, k=9)[0][:, 8]
    typical_m = float(np.median(eighth_m))
    points_m = np.asarray(points_m[eighth_m < LONELY * typical_m])
    spacing_m = max(typical_m * float(np.sqrt(np.pi / 8.0)), 1e-4)
    count = int(np.clip(np.pi * (NORMAL_RADIUS_M / spacing_m) ** 2, *NEIGHBOURS))
    normals, roughness_m = _local_planes(points_m, min(count, len(points_m)))
    noise_m = float(np.quantile(roughness_m, NOISE_SHARE)) * (MESH_NOISE if from_mesh else 1.0)
    gap_m = MESH_BRIDGED_M if from_mesh else max(BRIDGED_SPACINGS * spacing_m, BRIDGED_M)
    return Samples(points_m, normals, roughness_m, spacing_m, noise_m, gap_m)


def estimate_normals(points_m: Points, count: int) -> Points:
    """Normals, up to their sign, of planes through the nearest ``count`` points of each."""
    return _local_planes(points_m, min(count, len(points_m)))[0]


def _local_planes(points_m: Points, count: int) -> tuple[Points, Series]:
    """Normals that point up, and rms distances, of planes through the nearest ``count`` points."""
    tree = cKDTree(points_m)
    normals, roughness_m = np.empty_like(points_m), np.empty(len(points_m))
    for start in range(0, len(points_m), CHUNK):
        chunk = slice(start, start + CHUNK)
        near: Int[np.ndarray, "n k"] = tree.query(points_m[chunk], k=count)[1].reshape(-1, count)
        local = points_m[near]
        local -= local.mean(axis=1, keepdims=True)
        values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local) / max(count - 3, 1))
        n = vectors[:, :, 0]
        normals[chunk] = n * np.where(n[:, 2:] < 0.0, -1.0, 1.0)
        roughness_m[chunk] = np.sqrt(np.maximum(values[:, 0], 0.0))
    return normals, roughness_m


def fit_plane(points_m: Points) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Middle of the points, and the normal (upwards) of the plane with the least squared distances."""
    middle = points_m.mean(axis=0)
    local = points_m - middle
    n = np.linalg.eigh(local.T @ local)[1][:, 0]
    return middle, np.asarray(n if n[2] >= 0.0 else -n)
