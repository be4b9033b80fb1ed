"""Conversion of a problem to the flat arrays of the C++ solver, relative to the CoM at the start, forces in m |g|."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int

from stridelab.centroidal.boundary_conditions import Terminal
from stridelab.centroidal.control import ContactPatch
from stridelab.centroidal.force_splines import INNER, touchdowns_and_liftoffs
from stridelab.centroidal.free_variables import ContactSpan, movable_spans
from stridelab.centroidal.placement_windows import placement_window_m
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.dynamics.spatial import Placement
from stridelab.reachability.gaussian_mixture import Mixture

POINTS_PER_BLOCK: Final = 4
"""Contact points per block; a contact with more points takes several blocks."""
MIN_WINDOW_M: Final = 1e-6
"""Placement windows up to this size count as empty."""
FAR_M: Final = 100.0
"""Replaces the missing one of two bounds on a height: the solver has slacks for both."""
ENDS: Final[tuple[Terminal, ...]] = ("rest", "capturable", "moving")
"""The ends in the order of their numbers in the C++ solver."""
MixtureArrays = tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_ 3"], Float[np.ndarray, "_ 3 3"]]
"""Constants, means and whitenings: ``log w_j N(y; mu_j, S_j) = constant_j - |W_j (y - mu_j)|^2 / 2``."""


@dataclass(frozen=True)
class Slot:
    """A block of points in an interval: ``points`` points of ``effector``, starting at index ``first``."""

    effector: str
    first: int
    points: int


@dataclass(frozen=True, eq=False)
class NativeInput:
    """Arguments of ``stridelab_native.Problem`` in its order, and the blocks of every phase."""

    weights: Float[np.ndarray, "3"]
    start: Float[np.ndarray, "9"]
    goal: Float[np.ndarray, "9"]
    mixtures: list[MixtureArrays]
    visit_mixture: Int[np.ndarray, "visits"]
    visit_place: Float[np.ndarray, "visits 3"]
    visit_axes: Float[np.ndarray, "visits 3 3"]
    block_axes: Float[np.ndarray, "blocks 3 3"]
    block_points: Float[np.ndarray, "blocks 4 3"]
    block_count: Int[np.ndarray, "blocks"]
    block_effort: Float[np.ndarray, "blocks 2"]
    block_force_limit: Float[np.ndarray, "blocks"]
    phase_layout: Int[np.ndarray, "phases 5"]
    phase_step_s: Float[np.ndarray, "phases"]
    heights: Float[np.ndarray, "intervals 2"]
    end: int
    planes: Float[np.ndarray, "planes 5"]
    wrench_cones: Float[np.ndarray, "cones 6 6"]
    phase_cone: Int[np.ndarray, "phases"]
    duration_limits: Float[np.ndarray, "_"]
    block_edges: Int[np.ndarray, "blocks 2"]
    cubic: bool
    place_phases: Int[np.ndarray, "places 2"]
    place_axes: Float[np.ndarray, "places 2 3"]
    place_windows: Float[np.ndarray, "places 4"]
    block_place: Int[np.ndarray, "blocks"]
    visit_place_of: Int[np.ndarray, "visits"]
    limbs: Float[np.ndarray, "_ 3"]
    reference: Float[np.ndarray, "_ 3"]
    slots: tuple[tuple[Slot, ...], ...]
    moved: tuple[ContactSpan, ...]

    def module_arguments(self) -> list[object]:
        """Positional arguments of ``stridelab_native.Problem``."""
        return [value for name, value in vars(self).items() if name not in ("slots", "moved")]

    def active_controls(self, phase: int) -> Bool[np.ndarray, "controls blocks"]:
        """Which blocks of a phase have forces, per control point: one per interval, two for splines."""
        controls, first, blocks = self.phase_layout[phase, :3].tolist()
        active = np.ones((controls, blocks), dtype=bool)
        edges = self.block_edges[first : first + blocks].astype(bool)
        active[0, edges[:, 0]] = False
        active[-1, edges[:, 1]] = False
        return active


def native_input(problem: CentroidalProblem) -> NativeInput:
    """Convert a problem to the arrays of the C++ solver."""
    grid, origin, sequence, weights = problem.grid(), problem.com_start_m, problem.sequence, problem.weights
    names = [name for name in sequence.effectors if name in problem.proxies]
    controls = (INNER[problem.shape] * np.bincount(grid.phase)).tolist()
    blocks: list[tuple[ContactPatch, int]] = []
    slots: list[tuple[Slot, ...]] = []
    places: list[tuple[int, Placement]] = []
    layout = []
    movable_spans, place_axes, place_windows = _movable_contacts(problem)
    block_place, visit_place = [], []
    forces = problem.control.has_point_forces
    for i, phase in enumerate(sequence.phases):
        first_block, first_visit = len(blocks), len(places)
        patches = problem.contact_patches(i, origin)
        phase_blocks = [(t, k) for t in patches for k in range(0, len(t.points_m), POINTS_PER_BLOCK)] if forces else []
        blocks += phase_blocks
        block_place += [_movable_index(movable_spans, t.effector, i) for t, _ in phase_blocks]
        slots.append(tuple(Slot(t.effector, k, len(t.points_m[k : k + POINTS_PER_BLOCK])) for t, k in phase_blocks))
        for name in names:
            if name in phase.contacts:
                at, heading_rad = phase.contacts[name].placement, float(sequence.headings_rad[i])
                places.append((names.index(name), problem.proxies[name].frame_placement(at, heading_rad)))
                visit_place.append(_movable_index(movable_spans, name, i))
        layout.append([controls[i], first_block, len(phase_blocks), first_visit, len(places) - first_visit])
    points = np.zeros((len(blocks), POINTS_PER_BLOCK, 3))
    for b, (t, k) in enumerate(blocks):
        points[b, : len(t.points_m[k : k + POINTS_PER_BLOCK])] = t.points_m[k : k + POINTS_PER_BLOCK]
    wrench_cones, phase_cone = _wrench_cones(problem)
    start_l = problem.start.l_nms / problem.weight_n
    return NativeInput(
        weights=np.array(
            [weights.com_acceleration, weights.momentum_rate * problem.weight_n**2, weights.likelihood], dtype=float
        ),
        start=np.concatenate([np.zeros(3), problem.start.com_v_m_s, start_l]),
        goal=problem.end_state(),
        mixtures=[_mixture_arrays(problem.proxies[name].mixture) for name in names],
        visit_mixture=np.array([j for j, _ in places], dtype=np.int32),
        visit_place=np.array([at.position_m - origin for _, at in places], dtype=float).reshape(-1, 3),
        visit_axes=np.array([at.rotation for _, at in places], dtype=float).reshape(-1, 3, 3),
        block_axes=np.array(
            [t.rotation * np.array([t.friction, t.friction, 1.0]) for t, _ in blocks], dtype=float
        ).reshape(-1, 3, 3),
        block_points=points,
        block_count=np.array([len(t.points_m[k : k + POINTS_PER_BLOCK]) for t, k in blocks], dtype=np.int32),
        block_effort=np.array(
            [[2.0 * t.force_weight * t.friction**2, 2.0 * t.force_weight] for t, _ in blocks], dtype=float
        ).reshape(-1, 2),
        block_force_limit=np.array(
            [problem.bounds.normal_force_max_n.get(t.effector, np.inf) / problem.weight_n for t, _ in blocks],
            dtype=float,
        ),
        phase_layout=np.array(layout, dtype=np.int32),
        phase_step_s=np.array([p.duration_s / n for p, n in zip(sequence.phases, controls, strict=True)], dtype=float),
        heights=_height_bounds(problem),
        end=ENDS.index(problem.terminal),
        planes=_capture_planes(problem),
        wrench_cones=wrench_cones,
        phase_cone=phase_cone,
        duration_limits=_duration_limits(problem),
        block_edges=_zero_force_edges(problem, slots),
        cubic=problem.shape == "cubic",
        place_phases=np.array([[span.first, span.last] for span in movable_spans], dtype=np.int32).reshape(-1, 2),
        place_axes=place_axes,
        place_windows=place_windows,
        block_place=np.array(block_place, dtype=np.int32),
        visit_place_of=np.array(visit_place, dtype=np.int32),
        limbs=np.zeros((0, 3)) if problem.limbs_nm is None else problem.limbs_nm / problem.weight_n,
        reference=np.zeros((0, 3)) if problem.reference_m_s2 is None else problem.reference_m_s2,
        slots=tuple(slots),
        moved=movable_spans,
    )


def _movable_contacts(
    problem: CentroidalProblem,
) -> tuple[tuple[ContactSpan, ...], Float[np.ndarray, "places 2 3"], Float[np.ndarray, "places 4"]]:
    """Movable contacts ordered by their last phase, with axes and windows (low, high, low, high).

    An axis with an empty window is zero; its window is then a placeholder.
    """
    moved, axes, windows = [], [], []
    if problem.placements is not None:
        for span in sorted(movable_spans(problem.sequence), key=lambda span: span.last):
            corners_m = problem.effectors[span.contact.effector].points_m()
            low, high = placement_window_m(
                span.contact, corners_m, problem.sequence.terrain, problem.placements.reach_m
            )
            free = high - low > MIN_WINDOW_M
            if free.any():
                moved.append(span)
                axes.append(np.where(free, span.contact.placement.rotation[:, :2], 0.0).T)
                windows.append(np.where(free, [low, high], [[-1.0], [1.0]]).T.ravel())
    return tuple(moved), np.array(axes).reshape(-1, 2, 3), np.array(windows).reshape(-1, 4)


def _movable_index(spans: tuple[ContactSpan, ...], effector: str, phase: int) -> int:
    """Index of the movable contact of an effector in a phase; -1 if it has none."""
    of = (i for i, s in enumerate(spans) if s.contact.effector == effector and s.first <= phase <= s.last)
    return next(of, -1)


def wrench_cone(problem: CentroidalProblem, phase: int) -> Float[np.ndarray, "6 6"] | None:
    """G of the wrench control (tau, eta), padded with zero columns to six dimensions; eta in body weights.

    None in flight and for point forces as control.
    """
    if problem.control.has_point_forces:
        return None
    groups = problem.control.generators(problem.contact_patches(phase, problem.com_start_m))
    if not groups:
        return None
    (group,) = groups.values()
    G = np.zeros((6, 6))
    G[:, : group.lorentz] = group.wrench[:, :-1]
    G[:, -1] = group.wrench[:, -1]
    return np.asarray(G * group.rest[-1])


def _wrench_cones(problem: CentroidalProblem) -> tuple[Float[np.ndarray, "cones 6 6"], Int[np.ndarray, "phases"]]:
    cones: list[Float[np.ndarray, "6 6"]] = []
    phase_cone = []
    for i in range(len(problem.sequence.phases)):
        cone = wrench_cone(problem, i)
        phase_cone.append(-1 if cone is None else len(cones))
        cones += [] if cone is None else [cone]
    return np.array(cones).reshape(-1, 6, 6), np.array(phase_cone, dtype=np.int32)


def _duration_limits(problem: CentroidalProblem) -> Float[np.ndarray, "_"]:
    """Shortest and longest durations as shares of the given ones, total (s), price per second; empty if fixed."""
    free = problem.durations
    if free is None or free.shortest == free.longest:
        return np.zeros(0)
    total_s = problem.sequence.duration_s if free.fixed_total else np.inf
    return np.array([free.shortest, free.longest, total_s, free.price_per_s])


def _zero_force_edges(problem: CentroidalProblem, slots: list[tuple[Slot, ...]]) -> Int[np.ndarray, "blocks 2"]:
    """Whether the contact of a block touches down and lifts off with its phase: its splines start or end at zero."""
    empty: set[tuple[int, str]] = set()
    comes, goes = touchdowns_and_liftoffs(problem.sequence) if problem.shape == "cubic" else (empty, empty)
    edges = [((i, slot.effector) in comes, (i, slot.effector) in goes) for i, of in enumerate(slots) for slot in of]
    return np.array(edges, dtype=np.int32).reshape(-1, 2)


def _height_bounds(problem: CentroidalProblem) -> Float[np.ndarray, "intervals 2"]:
    """CoM height bounds per interval, relative to the start: both infinite or both finite, as the solver needs them.

    Splines have two intervals between nodes.
    """
    windows_m = problem.com_height_windows_m()
    is_bounded = np.isfinite(windows_m).any(axis=1, keepdims=True)
    windows_m = np.where(is_bounded, np.clip(windows_m, -FAR_M, FAR_M), windows_m)
    return np.asarray(np.repeat(windows_m, INNER[problem.shape], axis=0))


def _capture_planes(problem: CentroidalProblem) -> Float[np.ndarray, "planes 5"]:
    """Half-planes of the capture region of a capturable end; empty for rest."""
    end = problem.capture_region()
    if end is None:
        return np.zeros((0, 5))
    return np.column_stack([end.normals, end.normals / end.omega_1_s, end.offsets])


def _mixture_arrays(mixture: Mixture) -> MixtureArrays:
    W = mixture.inverse_cholesky
    log_det = np.log(np.einsum("jaa->ja", W)).sum(axis=1)
    constants = np.log(mixture.weights) + log_det - 1.5 * np.log(2.0 * np.pi)
    return np.ascontiguousarray(constants), np.ascontiguousarray(mixture.means_m), np.ascontiguousarray(W)
