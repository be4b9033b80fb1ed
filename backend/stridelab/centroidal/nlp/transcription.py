"""Transcription of a problem: parameters, bounds and initial guess for the compiled program of its structure.

Rows are equalities, interval by interval

    x_{k+1} - A x_k - B (F, T)_k = b                 (4.8) by the exact step of ``dynamics``
    (F, T)_k - sum of G u = 0                        (4.2), u_f or u_c

and the boundary values; the cones are bounds on u, and Lorentz cones one inequality each. All but those are linear
unless durations or contacts are free. The wrench as a separate variable limits the Hessian of the objective to 12 x 12
per interval, independent of the number of points.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.boundary_conditions import CaptureRegion
from stridelab.centroidal.contact_wrench import DOWN, N_STATE, N_WRENCH
from stridelab.centroidal.control import Generators
from stridelab.centroidal.force_splines import INNER, N_GAUSS, junction_weights, touchdowns_and_liftoffs
from stridelab.centroidal.free_variables import ContactSpan, movable_spans
from stridelab.centroidal.nlp.kkt import Box
from stridelab.centroidal.nlp.nlp import CAPTURE, Compiled, compiled_program, spline_parts
from stridelab.centroidal.nlp.variable_layout import (
    N_CAPTURABLE,
    DensityTerm,
    Group,
    Layout,
    PhaseStructure,
    Structure,
    Use,
    n_cones,
    n_limits,
)
from stridelab.centroidal.placement_windows import placement_window_m
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.centroidal.state_density import phase_quadratic
from stridelab.conventions import Series, Vector3
from stridelab.reachability.gaussian_mixture import Mixture

PhaseGenerators = Mapping[str, Generators]


@dataclass(frozen=True, eq=False)
class Transcription:
    """``min f(w, p)  s.t.  row_lower <= g(w, p) <= row_upper,  lower <= w <= upper``.

    Positions are relative to ``origin_m``, the CoM at the start; forces are in units of m |g|. ``guess`` is the initial
    guess of the thesis: a straight CoM path, zero velocity everywhere, the weight shared equally by the points.
    """

    problem: CentroidalProblem
    grid: Grid
    compiled: Compiled
    origin_m: Vector3
    movable_spans: tuple[ContactSpan, ...]
    p: Float[np.ndarray, "parameters"]
    box: Box
    guess: Series

    @property
    def layout(self) -> Layout:
        """Indices of variables and rows."""
        return self.compiled.layout

    def node_states(self, w: Series) -> Float[np.ndarray, "nodes 9"]:
        """``x_k`` of all nodes."""
        return np.asarray(w[self.layout.state[:, None] + np.arange(N_STATE)])


def transcribe(problem: CentroidalProblem) -> Transcription:
    """Transcribe a problem; the program of its structure is compiled if it is not cached."""
    grid, origin = problem.grid(), problem.com_start_m
    spans = tuple(movable_spans(problem.sequence)) if problem.placements else ()
    generators = [
        problem.control.generators(problem.contact_patches(i, origin)) for i in range(len(problem.sequence.phases))
    ]
    mixtures = {name: problem.proxies[name].mixture for name in problem.sequence.effectors if name in problem.proxies}
    end = problem.capture_region()
    program = compiled_program(_problem_structure(problem, grid, generators, spans, mixtures, end), mixtures)
    parameters = _parameter_values(problem, grid, generators, program, end)
    blocks = [parameters[name].ravel() for name, _ in program.nlp.parameters]
    return Transcription(
        problem=problem,
        grid=grid,
        compiled=program,
        origin_m=origin,
        movable_spans=spans,
        p=np.concatenate(blocks),
        box=Box(
            *_variable_bounds(problem, grid, program.layout, spans), *_row_bounds(problem, grid, program.layout, end)
        ),
        guess=_initial_guess(problem, grid, generators, program.layout),
    )


def _problem_structure(
    problem: CentroidalProblem,
    grid: Grid,
    generators: list[PhaseGenerators],
    spans: tuple[ContactSpan, ...],
    mixtures: Mapping[str, Mixture],
    end: CaptureRegion | None,
) -> Structure:
    counts = np.bincount(grid.phase, minlength=len(generators))
    phases = []
    for i, groups in enumerate(generators):
        shift = {span.contact.effector: s for s, span in enumerate(spans) if span.first <= i <= span.last}
        contacts = problem.sequence.phases[i].contacts
        phases.append(
            PhaseStructure(
                int(counts[i]),
                tuple(
                    Group(
                        name=name,
                        size=g.wrench.shape[1],
                        lorentz=g.lorentz,
                        block=len(g.regulariser),
                        weighed=bool(g.regulariser.any()),
                        limited=name in problem.bounds.normal_force_max_n,
                        shift=shift.get(name),
                    )
                    for name, g in groups.items()
                ),
                tuple(DensityTerm(name, shift.get(name)) for name in contacts if name in mixtures),
            )
        )
    return Structure(
        phases=tuple(phases),
        densities=tuple((name, _mixture_digest(mixture)) for name, mixture in mixtures.items()),
        free_durations=problem.durations is not None,
        fixed_total=problem.durations is not None and problem.durations.fixed_total,
        n_shifts=len(spans),
        capture_planes=0 if end is None else len(end.offsets),
        shape=problem.shape,
        state_densities=bool(problem.state_densities),
    )


def _mixture_digest(mixture: Mixture) -> bytes:
    parts = (mixture.weights, mixture.means_m, mixture.covariances_m2)
    return blake2b(b"".join(np.ascontiguousarray(part).tobytes() for part in parts), digest_size=16).digest()


def _parameter_values(
    problem: CentroidalProblem,
    grid: Grid,
    generators: list[PhaseGenerators],
    compiled: Compiled,
    end: CaptureRegion | None,
) -> dict[str, Float[np.ndarray, "uses q"]]:
    """Parameters of every part, one row per use."""
    weights, sequence = problem.weights, problem.sequence
    counts, inner = np.bincount(grid.phase), INNER[problem.shape]
    lengths = 1.0 / counts if problem.durations else sequence.durations_s / counts
    h = lengths[grid.phase]
    weight_rows = np.tile([weights.com_acceleration, weights.momentum_rate * problem.weight_n**2], (len(h), 1))
    n_rates = {"constant": 1, "cubic": N_GAUSS}[problem.shape]
    limbs = np.zeros((len(h), 3 * n_rates))
    if problem.limbs_nm is not None:
        limbs = problem.limbs_nm.reshape(len(h), -1) / problem.weight_n
    reference = np.zeros_like(limbs) if problem.reference_m_s2 is None else problem.reference_m_s2.reshape(len(h), -1)
    targets = np.hstack([weight_rows, limbs, reference])
    numbers = {"squares": np.column_stack([h, targets]), "gap": h[:, None]}
    if problem.state_densities:
        per_phase = np.array(
            [phase_quadratic(problem.state_densities, phase, problem.weight_n) for phase in sequence.phases]
        )
        numbers["state density"] = np.column_stack([h, weights.likelihood * per_phase[grid.phase]])
    if problem.shape == "cubic":
        junctions = np.column_stack([h, junction_weights(h)])
        for part, k, _ in spline_parts(len(h)):
            numbers |= {f"gap{part}": junctions[k], f"squares{part}": np.hstack([junctions, targets])[k]}
    for name, uses in compiled.ties.items():
        rows = []
        for use in uses:
            row = generators[use.phase][use.group.name].wrench.ravel(order="F")
            rows.append(
                row
                if use.group.shift is None
                else np.append(row, _displacement_axes(problem, use.group.name, use.phase))
            )
        numbers[name] = np.array(rows)
    for name, uses in compiled.efforts.items():
        numbers[name] = np.array(
            [
                np.append(lengths[use.phase] / inner, generators[use.phase][use.group.name].regulariser.ravel())
                for use in uses
                for _ in range(0, use.group.size, use.group.block)
            ]
        )
    for name, uses in compiled.limits.items():
        numbers[name] = np.array(
            [generators[use.phase][use.group.name].normal for use in uses for _ in range(n_limits(use.group))]
        )
    if end is not None:
        numbers[CAPTURE] = np.hstack([end.normals, end.normals / end.omega_1_s])
    for name, (effector, visits) in compiled.visits.items():
        moving = name.endswith(" moving")
        rows = []
        frames = {i: _density_frame(problem, effector, i) for i in {visit.phase for visit in visits}}
        for visit in visits:
            share = weights.likelihood * visit.share * lengths[visit.phase]
            row = np.append(share, frames[visit.phase])
            rows.append(np.append(row, _displacement_axes(problem, effector, visit.phase)) if moving else row)
        numbers[name] = np.array(rows)
    if problem.durations:
        numbers["price"] = np.full((len(sequence.phases), 1), problem.durations.price_per_s)
    for name, _ in compiled.nlp.parameters:
        numbers.setdefault(name, np.zeros((0, 0)))
    return numbers


def _displacement_axes(problem: CentroidalProblem, effector: str, phase: int) -> Float[np.ndarray, "6"]:
    """Displacement axes x and y of a contact, concatenated."""
    return problem.contact(effector, phase).placement.rotation[:, :2].ravel(order="F")


def _density_frame(problem: CentroidalProblem, effector: str, phase: int) -> Float[np.ndarray, "12"]:
    """Position and axes (by columns) of an effector's density."""
    contact, heading_rad = problem.contact(effector, phase), float(problem.sequence.headings_rad[phase])
    frame = problem.proxies[effector].frame_placement(contact.placement, heading_rad)
    return np.append(frame.position_m - problem.com_start_m, frame.rotation.ravel(order="F"))


def _variable_bounds(
    problem: CentroidalProblem, grid: Grid, layout: Layout, spans: tuple[ContactSpan, ...]
) -> tuple[Series, Series]:
    lower, upper = np.full(layout.n, -np.inf), np.full(layout.n, np.inf)
    for use in layout.uses:
        group = use.group
        lower[use.start + group.lorentz : use.start + group.size : group.lorentz + 1] = 0.0
    if problem.shape == "cubic":
        for use in _zero_force_uses(problem, grid, layout):
            lower[use.start : use.start + use.group.size] = 0.0
            upper[use.start : use.start + use.group.size] = 0.0
    if problem.durations:
        T = problem.sequence.durations_s
        lower[layout.durations] = problem.durations.shortest * T
        upper[layout.durations] = problem.durations.longest * T
    for k, window_m in list(enumerate(problem.com_height_windows_m().tolist()))[1:]:
        lower[layout.state[k] + 2], upper[layout.state[k] + 2] = window_m
    if problem.placements:
        for span, at in zip(spans, layout.shifts, strict=True):
            corners_m = problem.effectors[span.contact.effector].points_m()
            window = placement_window_m(span.contact, corners_m, problem.sequence.terrain, problem.placements.reach_m)
            lower[at : at + 2], upper[at : at + 2] = window
    return lower, upper


def _zero_force_uses(problem: CentroidalProblem, grid: Grid, layout: Layout) -> list[Use]:
    """Control points adjacent to the touch-down or lift-off of their contact, whose force is zero."""
    comes, goes = touchdowns_and_liftoffs(problem.sequence)
    begins, ends = np.searchsorted(grid.phase, grid.phase, "left"), np.searchsorted(grid.phase, grid.phase, "right") - 1
    return [
        use
        for use in layout.uses
        if (use.inner == 0 and use.k == begins[use.k] and (use.phase, use.group.name) in comes)
        or (use.inner == 1 and use.k == ends[use.k] and (use.phase, use.group.name) in goes)
    ]


def _row_bounds(
    problem: CentroidalProblem, grid: Grid, layout: Layout, end: CaptureRegion | None
) -> tuple[Float[np.ndarray, "rows"], Float[np.ndarray, "rows"]]:
    lower = np.zeros(layout.n_rows)
    goal = problem.end_state()
    lower[layout.start + 3 : layout.start + N_STATE] = np.append(
        problem.start.com_v_m_s, problem.start.l_nms / problem.weight_n
    )
    if end is None:
        lower[layout.rest : layout.rest + 3] = -DOWN
        lower[layout.end : layout.end + N_STATE] = goal
    else:
        lower[layout.end] = goal[2]
    if problem.durations and problem.durations.fixed_total:
        lower[layout.total] = problem.sequence.duration_s
    upper = lower.copy()
    if problem.terminal == "moving":
        lower[layout.rest : layout.rest + 3], upper[layout.rest : layout.rest + 3] = -np.inf, np.inf
    if end is not None:
        first = layout.end + N_CAPTURABLE
        lower[first : first + len(end.offsets)] = -np.inf
        upper[first : first + len(end.offsets)] = end.offsets
    for use in layout.uses:
        limits = use.row + n_cones(use.group)
        upper[use.row : limits] = np.inf
        if use.group.limited:
            lower[limits : limits + n_limits(use.group)] = -np.inf
            upper[limits : limits + n_limits(use.group)] = (
                problem.bounds.normal_force_max_n[use.group.name] / problem.weight_n
            )
    if problem.shape == "cubic":
        # Zero forces lie at the apex of their cone, where its row has zero gradient: its multiplier would grow, and
        # ipopt scales its termination criteria by the size of multipliers.
        for use in _zero_force_uses(problem, grid, layout):
            lower[use.row : use.row + n_cones(use.group)] = -np.inf
    return lower, upper


def _initial_guess(problem: CentroidalProblem, grid: Grid, generators: list[PhaseGenerators], layout: Layout) -> Series:
    w = np.zeros(layout.n)
    share = grid.time_s / grid.time_s[-1]
    w[layout.state[:, None] + np.arange(3)] = share[:, None] * (problem.com_end_m - problem.com_start_m)
    for use in layout.uses:
        G = generators[use.phase][use.group.name]
        w[use.start : use.start + use.group.size] = G.rest
        w[layout.wrench[use.k, use.inner] + np.arange(N_WRENCH)] += G.wrench @ G.rest
    if problem.durations:
        w[layout.durations] = [phase.duration_s for phase in problem.sequence.phases]
    return w
