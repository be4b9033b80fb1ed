"""The nonlinear program of a problem structure: which stage function applies to which variables and rows.

Problems of the same structure differ only in the parameters of the compiled program, which is therefore cached.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Int

from stridelab.centroidal.contact_wrench import N_STATE, N_WRENCH
from stridelab.centroidal.nlp import cubic_stage_functions as cubic_stage
from stridelab.centroidal.nlp import stage_functions as stage
from stridelab.centroidal.nlp.assembly import ConstraintPart, CostPart, NonlinearProgram, assemble_nlp
from stridelab.centroidal.nlp.stage_functions import CostFunctions, RowFunctions, likelihood_functions
from stridelab.centroidal.nlp.variable_layout import (
    N_CAPTURABLE,
    Layout,
    Structure,
    Use,
    create_layout,
    n_cones,
    n_limits,
)
from stridelab.reachability.gaussian_mixture import Mixture

OBJECTIVE_SCALE: Final = 1e-2
"""Objective scale; brings its gradient to the order of the constraints' gradients."""
CAPTURE: Final = "capture"
"""Name of the rows of the capture point."""
MAX_CACHED_PROGRAMS: Final = 8
"""Number of compiled programs in the cache."""


@dataclass(frozen=True)
class Visit:
    """A node at which the log-density of an effector is evaluated, as a share of an interval of ``phase``."""

    node: int
    phase: int
    share: float


@dataclass(frozen=True, eq=False)
class Compiled:
    """The compiled program of a structure, with the layout of its variables and parameters.

    ``ties``, ``efforts`` and ``limits`` are uses of groups by the name of their part, ``visits`` those of a density;
    ``solvers`` caches its solver instances.
    """

    structure: Structure
    layout: Layout
    nlp: NonlinearProgram
    ties: Mapping[str, list[Use]]
    efforts: Mapping[str, list[Use]]
    limits: Mapping[str, list[Use]]
    visits: Mapping[str, tuple[str, list[Visit]]]
    solvers: dict[Hashable, object] = field(default_factory=dict)


_compiled_programs: dict[Structure, Compiled] = {}


def compiled_program(structure: Structure, mixtures: Mapping[str, Mixture]) -> Compiled:
    """The program of ``structure``, compiled at first use and cached (least recently used); not thread-safe."""
    if structure in _compiled_programs:
        _compiled_programs[structure] = _compiled_programs.pop(structure)
    else:
        _compiled_programs[structure] = _compile_program(structure, mixtures)
        for oldest in list(_compiled_programs)[:-MAX_CACHED_PROGRAMS]:
            del _compiled_programs[oldest]
    return _compiled_programs[structure]


def _compile_program(structure: Structure, mixtures: Mapping[str, Mixture]) -> Compiled:
    layout, free = create_layout(structure), structure.free_durations
    phase_of = np.array(structure.phase_of)
    costs: list[CostPart] = []
    rows: list[ConstraintPart] = []

    def with_durations(of_y: Int[np.ndarray, "uses y"], phases: Int[np.ndarray, "uses"]) -> Int[np.ndarray, "uses z"]:
        """Append the duration of its phase to each y, if durations are free."""
        return np.column_stack([of_y, layout.durations[phases]]) if free else of_y

    def add_cost(name: str, of_y: Int[np.ndarray, "uses y"], functions: CostFunctions) -> None:
        costs.append(CostPart(name, of_y, functions))

    def add_rows(
        name: str, of_y: Int[np.ndarray, "uses y"], first_row: Int[np.ndarray, "uses"], functions: RowFunctions
    ) -> None:
        of_row = _index_ranges(first_row, functions.value.size1_out(0))
        rows.append(ConstraintPart(name, of_y, of_row, functions))

    x, F = layout.state, layout.wrench
    if structure.shape == "cubic":
        for name, k, (first, last) in spline_parts(len(phase_of)):
            before = _index_ranges(F[k - 1, 1], N_WRENCH)[:, first * N_WRENCH :]
            after = _index_ranges(F[(k + 1) % len(F), 0], N_WRENCH)[:, last * N_WRENCH :]
            own = _index_ranges(F[k, 0], 2 * N_WRENCH)
            of_y = np.hstack([before, _index_ranges(x[k], 6), own, after])
            add_cost(f"squares{name}", of_y, cubic_stage.squared_rates(first, last))
            across = np.hstack([before, _index_ranges(x[k], N_STATE), own, _index_ranges(x[k + 1], N_STATE), after])
            add_rows(f"gap{name}", across, layout.gap[k], cubic_stage.dynamics_gap(first, last))
    else:
        wrench = _index_ranges(F[:, 0], N_WRENCH)
        of_y = np.hstack([_index_ranges(x[:-1], 6), wrench])
        add_cost("squares", with_durations(of_y, phase_of), stage.squared_rates(free))
        if structure.state_densities:
            of_y = np.hstack([_index_ranges(x[:-1], N_STATE), wrench])
            add_cost("state density", of_y, stage.state_density_cost())
        across = np.hstack([_index_ranges(x[:-1], N_STATE), wrench, _index_ranges(x[1:], N_STATE)])
        add_rows("gap", with_durations(across, phase_of), layout.gap, stage.dynamics_gap(free))
    add_rows("start", _index_ranges(x[:1], N_STATE), np.array([layout.start]), stage.identity_rows(N_STATE))
    end = np.array([layout.end])
    if structure.capture_planes:
        add_rows("end height", x[-1:, None] + np.array([2, 5]), end, stage.identity_rows(2))
        add_rows("end momentum", _index_ranges(x[-1:], N_STATE), end + 2, stage.momentum_about_com())
        planes = N_CAPTURABLE + end + np.arange(structure.capture_planes)
        of_y = np.repeat(x[-1:, None] + np.array([0, 1, 3, 4]), len(planes), axis=0)
        add_rows(CAPTURE, of_y, planes, stage.dot_product(4))
    else:
        add_rows("end", _index_ranges(x[-1:], N_STATE), end, stage.identity_rows(N_STATE))
        add_rows("rest", _index_ranges(F[-1:, -1], 3), np.array([layout.rest]), stage.identity_rows(3))
    add_rows("wrench", _index_ranges(F.ravel(), N_WRENCH), layout.tie.ravel(), stage.identity_rows(N_WRENCH))

    ties, efforts, limits = _group_uses(layout.uses)
    for name, uses in ties.items():
        group = uses[0].group
        of_y = _index_ranges(np.array([use.start for use in uses]), group.size)
        if group.shift is not None:
            of_y = np.hstack([of_y, _index_ranges(layout.shifts[_shift_indices(uses)], 2)])
        of_row = np.array([layout.tie[use.k, use.inner] for use in uses])
        add_rows(name, of_y, of_row, stage.wrench_tie(group.size, group.shift is not None))
    for name, uses in efforts.items():
        size = uses[0].group.block
        starts = np.array([use.start + i for use in uses for i in range(0, use.group.size, size)])
        phases = np.array([use.phase for use in uses for _ in range(0, use.group.size, size)])
        add_cost(name, with_durations(_index_ranges(starts, size), phases), stage.effort_cost(size, free))
    for name, uses in limits.items():
        size = uses[0].group.block
        of_y, of_row = np.array(
            [
                (use.start + i * size, use.row + n_cones(use.group) + i)
                for use in uses
                for i in range(n_limits(use.group))
            ]
        ).T
        add_rows(name, _index_ranges(of_y, size), of_row, stage.dot_product(size))
    for size in sorted({use.group.lorentz for use in layout.uses} - {0}):
        cones = [
            (use.start + i * (size + 1), use.row + i)
            for use in layout.uses
            if use.group.lorentz == size
            for i in range(n_cones(use.group))
        ]
        of_y, of_row = np.array(cones).T
        add_rows(f"cone {size}", _index_ranges(of_y, size + 1), of_row, stage.cone_row(size))

    visits: dict[str, tuple[str, list[Visit]]] = {}
    for effector, _ in structure.densities:
        functions = likelihood_functions(mixtures[effector])
        for moving in (False, True):
            nodes, shifts = _density_nodes(structure, effector, moving)
            if not nodes:
                continue
            name = f"density {effector}{' moving' if moving else ''}"
            visits[name] = (effector, nodes)
            of_y = _index_ranges(x[[visit.node for visit in nodes]], 3)
            if moving:
                of_y = np.hstack([of_y, _index_ranges(layout.shifts[shifts], 2)])
            phases = np.array([visit.phase for visit in nodes])
            add_cost(name, with_durations(of_y, phases), stage.density_cost(functions, free, moving))
    if free:
        of_y = layout.durations[:, None]
        add_cost("price", of_y, stage.duration_price())
        if structure.fixed_total:
            add_rows("total", of_y, np.full(len(of_y), layout.total), stage.identity_rows(1))
    nlp = assemble_nlp(layout.n, layout.n_rows, costs, rows, OBJECTIVE_SCALE)
    return Compiled(structure, layout, nlp, ties, efforts, limits, visits)


def spline_parts(n: int) -> list[tuple[str, Int[np.ndarray, "uses"], tuple[bool, bool]]]:
    """Parts of ``n`` spline intervals: name suffix, intervals, (is first, is last)."""
    parts = [
        ("", np.arange(1, n - 1), (False, False)),
        (" first", np.array([0]), (True, False)),
        (" last", np.array([n - 1]), (False, True)),
    ]
    return [part for part in parts if len(part[1])]


def _index_ranges(starts: Int[np.ndarray, "uses"], size: int) -> Int[np.ndarray, "uses size"]:
    return starts[:, None] + np.arange(size)


def _shift_indices(uses: list[Use]) -> list[int]:
    return [use.group.shift for use in uses if use.group.shift is not None]


Uses = dict[str, list[Use]]


def _group_uses(uses: tuple[Use, ...]) -> tuple[Uses, Uses, Uses]:
    """Group uses that share a function: for the wrench, the regulariser and the bounds on normal forces."""
    ties: dict[str, list[Use]] = {}
    efforts: dict[str, list[Use]] = {}
    limits: dict[str, list[Use]] = {}
    for use in uses:
        group = use.group
        ties.setdefault(f"tie {group.size}{'' if group.shift is None else ' moving'}", []).append(use)
        if group.weighed:
            efforts.setdefault(f"effort {group.block}", []).append(use)
        if group.limited:
            limits.setdefault(f"limit {group.block}", []).append(use)
    return ties, efforts, limits


def _density_nodes(structure: Structure, effector: str, moving: bool) -> tuple[list[Visit], list[int]]:
    """Nodes of the trapezoidal rule over the phases in which an effector is in contact, and their shifts.

    ``moving`` selects movable or fixed contacts. A node between two phases counts half for the contacts of each.
    """
    nodes: list[Visit] = []
    shifts: list[int] = []
    first = 0
    for i, phase in enumerate(structure.phases):
        for visited in phase.densities:
            if visited.effector != effector or (visited.shift is not None) != moving:
                continue
            for k in range(phase.intervals + 1):
                nodes.append(Visit(first + k, i, 0.5 if k in (0, phase.intervals) else 1.0))
                shifts.append(-1 if visited.shift is None else visited.shift)
        first += phase.intervals
    return nodes, shifts
