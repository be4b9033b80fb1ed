"""The numbers that a problem puts into the programme of its structure: parameters, bounds and the first guess.

Rows are equalities, interval by interval

    x_{k+1} - A x_k - B (F, T)_k = b                 (4.8) by the exact step of ``dynamics``
    (F, T)_k - sum of G u = 0                        (4.2), u_f or u_c

and the boundary values; the cones are bounds on u, and where they are Lorentz cones one inequality each. All but
those are linear unless durations or contacts are free. The wrench as a variable of its own keeps the curvature of the
objective to 12 x 12 per interval whatever the number of points.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.boundary_conditions import Capture, capture
from stridelab.centroidal.control import Generators
from stridelab.centroidal.dynamics import DOWN, N_STATE, N_WRENCH
from stridelab.centroidal.force_splines import INNER, N_GAUSS, comes_and_goes, joints
from stridelab.centroidal.free_variables import Stay, movable
from stridelab.centroidal.nlp.kkt import Box
from stridelab.centroidal.nlp.nlp import CAPTURE, Compiled, compiled, splines
from stridelab.centroidal.nlp.variable_layout import (
    N_CAPTURABLE,
    Group,
    Layout,
    PhaseStructure,
    Structure,
    Use,
    Visited,
    n_cones,
    n_limits,
)
from stridelab.centroidal.placement_windows import room_m
from stridelab.centroidal.problem import CentroidalProblem, Grid
from stridelab.conventions import Series, Vector3
from stridelab.errors import InvalidInput
from stridelab.reachability.gaussian_mixture import Mixture

PhaseGenerators = Mapping[str, Generators]


@dataclass(frozen=True, eq=False)
class Transcription:
    """``min f(w, p)  s.t.  row_lower <= g(w, p) <= row_upper,  lower <= w <= upper``.

    Positions inside are relative to ``origin_m``, the CoM at the start; forces are in units of m |g|. ``guess`` is the
    thesis' own start: a straight CoM path, at rest everywhere, the weight shared equally by the points.
    """

    problem: CentroidalProblem
    grid: Grid
    compiled: Compiled
    origin_m: Vector3
    movable: tuple[Stay, ...]
    p: Float[np.ndarray, "parameters"]
    box: Box
    guess: Series

    @property
    def layout(self) -> Layout:
        """Where things stand."""
        return self.compiled.layout

    def states(self, w: Series) -> Float[np.ndarray, "nodes 9"]:
        """``x_k`` of all nodes."""
        return np.asarray(w[self.layout.state[:, None] + np.arange(N_STATE)])


def transcribe(problem: CentroidalProblem) -> Transcription:
    """Fill in the programme of the problem's structure, which is compiled where it is new."""
    grid, origin = problem.grid(), problem.com_start_m
    stays = tuple(movable(problem.sequence)) if problem.placements else ()
    generators = [problem.control.generators(problem.touches(i, origin)) for i in range(len(problem.sequence.phases))]
    mixtures = {name: problem.proxies[name].mixture for name in problem.sequence.effectors if name in problem.proxies}
    end = capture_of(problem)
    found = compiled(_structure(problem, grid, generators, stays, mixtures, end), mixtures)
    numbers = _numbers(problem, grid, generators, found, end)
    blocks = [numbers[name].ravel() for name, _ in found.programme.parameters]
    return Transcription(
        problem=problem,
        grid=grid,
        compiled=found,
        origin_m=origin,
        movable=stays,
        p=np.concatenate(blocks),
        box=Box(*_bounds(problem, grid, found.layout, stays), *_row_bounds(problem, grid, found.layout, end)),
        guess=_guess(problem, grid, generators, found.layout),
    )


def _structure(
    problem: CentroidalProblem,
    grid: Grid,
    generators: list[PhaseGenerators],
    stays: tuple[Stay, ...],
    mixtures: Mapping[str, Mixture],
    end: Capture | None,
) -> Structure:
    counts = np.bincount(grid.phase, minlength=len(generators))
    phases = []
    for i, groups in enumerate(generators):
        shift = {stay.contact.effector: s for s, stay in enumerate(stays) if stay.first <= i <= stay.last}
        touching = problem.sequence.phases[i].contacts
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
                tuple(Visited(name, shift.get(name)) for name in touching if name in mixtures),
            )
        )
    return Structure(
        phases=tuple(phases),
        densities=tuple((name, _digest(mixture)) for name, mixture in mixtures.items()),
        free_durations=problem.durations is not None,
        fixed_total=problem.durations is not None and problem.durations.fixed_total,
        n_shifts=len(stays),
        capture_planes=0 if end is None else len(end.offsets),
        shape=problem.shape,
    )


def _digest(mixture: Mixture) -> bytes:
    parts = (mixture.weights, mixture.means_m, mixture.covariances_m2)
    return blake2b(b"".join(np.ascontiguousarray(part).tobytes() for part in parts), digest_size=16).digest()


def _numbers(
    problem: CentroidalProblem,
    grid: Grid,
    generators: list[PhaseGenerators],
    found: Compiled,
    end: Capture | None,
) -> dict[str, Float[np.ndarray, "uses q"]]:
    """The parameters of every part, one row per use."""
    weights, sequence = problem.weights, problem.sequence
    counts, inner = np.bincount(grid.phase), INNER[problem.shape]
    lengths = 1.0 / counts if problem.durations else np.array([p.duration_s for p in sequence.phases]) / counts
    h = lengths[grid.phase]
    nothing = np.zeros((0, 0))
    priced = np.tile([weights.com_acceleration, weights.momentum_rate * problem.weight_n**2], (len(h), 1))
    n_rates = {"constant": 1, "cubic": N_GAUSS}[problem.shape]
    limbs = np.zeros((len(h), 3 * n_rates))
    if problem.limbs_nm is not None:
        limbs = problem.limbs_nm.reshape(len(h), -1) / problem.weight_n
    numbers = {"squares": np.column_stack([h, priced, limbs]), "gap": h[:, None]}
    if problem.shape == "cubic":
        joined = np.column_stack([h, joints(h)])
        for part, k, _ in splines(len(h)):
            numbers |= {f"gap{part}": joined[k], f"squares{part}": np.hstack([joined, priced, limbs])[k]}
    for name, uses in found.ties.items():
        rows = []
        for use in uses:
            row = generators[use.phase][use.group.name].wrench.ravel(order="F")
            rows.append(row if use.group.shift is None else np.append(row, _axes(problem, use.group.name, use.phase)))
        numbers[name] = np.array(rows)
    for name, uses in found.efforts.items():
        numbers[name] = np.array(
            [
                np.append(lengths[use.phase] / inner, generators[use.phase][use.group.name].regulariser.ravel())
                for use in uses
                for _ in range(0, use.group.size, use.group.block)
            ]
        )
    for name, uses in found.limits.items():
        numbers[name] = np.array(
            [generators[use.phase][use.group.name].normal for use in uses for _ in range(n_limits(use.group))]
        )
    if end is not None:
        numbers[CAPTURE] = np.hstack([end.normals, end.normals / end.omega_1_s])
    for name, (effector, visits) in found.visits.items():
        moving = name.endswith(" moving")
        rows = []
        frames = {i: _frame(problem, effector, i) for i in {visit.phase for visit in visits}}
        for visit in visits:
            share = weights.likelihood * visit.share * lengths[visit.phase]
            row = np.append(share, frames[visit.phase])
            rows.append(np.append(row, _axes(problem, effector, visit.phase)) if moving else row)
        numbers[name] = np.array(rows)
    if problem.durations:
        numbers["price"] = np.full((len(sequence.phases), 1), problem.durations.price_per_s)
    for name, _ in found.programme.parameters:
        numbers.setdefault(name, nothing)
    return numbers


def _axes(problem: CentroidalProblem, effector: str, phase: int) -> Float[np.ndarray, "6"]:
    """The directions in which a contact may move, one after the other."""
    return problem.contact(effector, phase).placement.rotation[:, :2].ravel(order="F")


def _frame(problem: CentroidalProblem, effector: str, phase: int) -> Float[np.ndarray, "12"]:
    """Place and axes of an effector's density."""
    contact, heading_rad = problem.contact(effector, phase), float(problem.sequence.headings_rad[phase])
    frame = problem.proxies[effector].placement(contact.placement, heading_rad)
    return np.append(frame.position_m - problem.com_start_m, frame.rotation.ravel(order="F"))


def _bounds(problem: CentroidalProblem, grid: Grid, layout: Layout, stays: tuple[Stay, ...]) -> tuple[Series, Series]:
    lower, upper = np.full(layout.n, -np.inf), np.full(layout.n, np.inf)
    for use in layout.uses:
        group = use.group
        lower[use.start + group.lorentz : use.start + group.size : group.lorentz + 1] = 0.0
    if problem.shape == "cubic":
        for use in _at_rest(problem, grid, layout):
            lower[use.start : use.start + use.group.size] = 0.0
            upper[use.start : use.start + use.group.size] = 0.0
    if problem.durations:
        T = np.array([phase.duration_s for phase in problem.sequence.phases])
        lower[layout.durations] = problem.durations.shortest * T
        upper[layout.durations] = problem.durations.longest * T
    if problem.bounds.com_height_m is not None:
        least, most = problem.bounds.com_height_m
        for k, phase in list(enumerate(grid.phase))[1:]:
            soles_m = ground_m(problem, int(phase)) - problem.com_start_m[2]
            lower[layout.state[k] + 2], upper[layout.state[k] + 2] = soles_m + least, soles_m + most
    if problem.placements:
        for stay, at in zip(stays, layout.shifts, strict=True):
            corners_m = problem.effectors[stay.contact.effector].points_m()
            room = room_m(stay.contact, corners_m, problem.sequence.terrain, problem.placements.reach_m)
            lower[at : at + 2], upper[at : at + 2] = room
    return lower, upper


def _at_rest(problem: CentroidalProblem, grid: Grid, layout: Layout) -> list[Use]:
    """Control points beside the instants at which their contact comes or goes."""
    comes, goes = comes_and_goes(problem.sequence)
    begins, ends = np.searchsorted(grid.phase, grid.phase, "left"), np.searchsorted(grid.phase, grid.phase, "right") - 1
    return [
        use
        for use in layout.uses
        if (use.inner == 0 and use.k == begins[use.k] and (use.phase, use.group.name) in comes)
        or (use.inner == 1 and use.k == ends[use.k] and (use.phase, use.group.name) in goes)
    ]


def ground_m(problem: CentroidalProblem, phase: int) -> float:
    """Mean height of the soles, each where it is in a phase or was last.

    Raises ``InvalidInput`` (``no-surface-contact``) where none has touched so far.
    """
    contacts = [problem.sequence.last_contact(name, phase) for name in problem.sequence.effectors]
    soles = [c for c in contacts if c is not None and problem.effectors[c.effector].kind == "surface"]
    if not soles:
        raise InvalidInput("no-surface-contact", "The height of the CoM is bounded above soles, and none has touched.")
    return float(np.mean([c.placement.position_m[2] for c in soles]))


def _row_bounds(
    problem: CentroidalProblem, grid: Grid, layout: Layout, end: Capture | None
) -> tuple[Float[np.ndarray, "rows"], Float[np.ndarray, "rows"]]:
    lower = np.zeros(layout.n_rows)
    goal_m = problem.com_end_m - problem.com_start_m
    lower[layout.start + 3 : layout.start + N_STATE] = np.append(
        problem.start.com_v_m_s, problem.start.l_nms / problem.weight_n
    )
    if end is None:
        lower[layout.rest : layout.rest + 3] = -DOWN
        lower[layout.end : layout.end + 3] = goal_m
    else:
        lower[layout.end] = goal_m[2]
    if problem.durations and problem.durations.fixed_total:
        lower[layout.total] = problem.sequence.duration_s
    upper = lower.copy()
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
        # Forces that are zero lie on the tip of their cone, where its row has no slope: a multiplier would grow and
        # loosen all that ipopt measures by the size of multipliers.
        for use in _at_rest(problem, grid, layout):
            lower[use.row : use.row + n_cones(use.group)] = -np.inf
    return lower, upper


def capture_of(problem: CentroidalProblem) -> Capture | None:
    """Relative to the origin; None where the motion ends at rest."""
    if problem.terminal == "rest":
        return None
    last = problem.touches(len(problem.sequence.phases) - 1, problem.com_start_m)
    return capture([touch.points_m for touch in last], problem.com_end_m - problem.com_start_m)


def _guess(problem: CentroidalProblem, grid: Grid, generators: list[PhaseGenerators], layout: Layout) -> Series:
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
