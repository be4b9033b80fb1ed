"""Layout of the vectors of variables and of rows.

    w = x_0, u_0, (F, T)_0,  x_1, u_1, (F, T)_1,  ...  x_N,  then displacements of contacts and durations of phases
    g = gap_0, x_0 = .., wrench_0, cones_0,  gap_1, wrench_1, cones_1,  ..  at rest_N-1,  x_N = ..,  total duration

which is the order required by stage-wise solvers.

``Structure`` holds what determines the shape of the nonlinear program; problems of the same structure share a solver.
It consists of the pattern of phases, their numbers of intervals, the sizes and cones of the groups of u, the mixtures
and the free variables. Contacts, durations, weights, friction and mass are parameters of the compiled program.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Int

from stridelab.centroidal.contact_wrench import N_STATE, N_WRENCH
from stridelab.centroidal.force_splines import INNER, Shape


@dataclass(frozen=True)
class Group:
    """``size`` variables of u in blocks of ``block``, one per point; ``lorentz`` as in ``Generators``.

    ``weighed``: whether effort has a cost; ``limited``: whether normal forces are bounded; ``shift``: index of the
    contact displacement that moves its points, None for fixed ones.
    """

    name: str
    size: int
    lorentz: int
    block: int
    weighed: bool
    limited: bool
    shift: int | None


@dataclass(frozen=True)
class DensityTerm:
    """An effector whose log-density is in the cost of a phase, and the displacement of its contact."""

    effector: str
    shift: int | None


@dataclass(frozen=True)
class PhaseStructure:
    """Number of ``intervals`` of a phase, its groups of u and its log-densities."""

    intervals: int
    groups: tuple[Group, ...]
    densities: tuple[DensityTerm, ...]


@dataclass(frozen=True)
class Structure:
    """Equal and hashable by its contents; ``densities`` pairs effectors with the digest of their mixture.

    ``capture_planes``: half-planes for the capture point at the end; 0: the motion ends at rest. ``shape`` is that of
    the controls within an interval; ``state_densities``: whether the cost has densities of velocity and rates.
    """

    phases: tuple[PhaseStructure, ...]
    densities: tuple[tuple[str, bytes], ...]
    free_durations: bool
    fixed_total: bool
    n_shifts: int
    capture_planes: int
    shape: Shape
    state_densities: bool = False

    @property
    def n_intervals(self) -> int:
        """Number of intervals of the whole motion."""
        return sum(phase.intervals for phase in self.phases)

    @property
    def phase_of(self) -> list[int]:
        """The phase of every interval."""
        return [i for i, phase in enumerate(self.phases) for _ in range(phase.intervals)]


N_CAPTURABLE: Final = 5
"""Rows at a capturable end before those of the capture point: height, vertical velocity, angular momentum."""


@dataclass(frozen=True)
class Use:
    """A group of u in interval ``k`` of ``phase``, at control point ``inner`` (0, or 0 and 1 for a spline).

    ``start`` is its first variable, ``row`` the row of its first cone.
    """

    group: Group
    k: int
    inner: int
    phase: int
    start: int
    row: int


@dataclass(frozen=True, eq=False)
class Layout:
    """First indices: ``state`` per node, ``gap`` per interval, ``wrench`` and ``tie`` (its rows) per control point.

    ``durations`` per phase and ``shifts`` per displacement (empty if not free); ``start``, ``rest``, ``end`` and
    ``total`` are the first rows of single conditions. ``stage_rows`` counts per node the rows other than dynamics.
    """

    n: int
    n_rows: int
    state: Int[np.ndarray, "nodes"]
    wrench: Int[np.ndarray, "intervals inner"]
    uses: tuple[Use, ...]
    durations: Int[np.ndarray, "phases"]
    shifts: Int[np.ndarray, "shifts"]
    gap: Int[np.ndarray, "intervals"]
    tie: Int[np.ndarray, "intervals inner"]
    start: int
    rest: int
    end: int
    total: int
    stage_rows: tuple[int, ...]

    @cached_property
    def uses_in(self) -> list[list[Use]]:
        """The groups of every interval."""
        groups: list[list[Use]] = [[] for _ in self.wrench]
        for use in self.uses:
            groups[use.k].append(use)
        return groups

    def uses_of(self, phase: int) -> Mapping[str, list[Use]]:
        """The groups of a phase, interval by interval and control point by control point."""
        groups: dict[str, list[Use]] = {}
        for use in self.uses:
            if use.phase == phase:
                groups.setdefault(use.group.name, []).append(use)
        return groups


def n_cones(group: Group) -> int:
    """Number of cone rows of a group."""
    return group.size // (group.lorentz + 1) if group.lorentz else 0


def n_limits(group: Group) -> int:
    """Number of normal-force rows of a group; they follow its cones."""
    return group.size // group.block if group.limited else 0


def create_layout(structure: Structure) -> Layout:
    """Compute the layout of a structure."""
    n = row = 0
    state, wrench, gap, tie, stage_rows = [], [], [], [], []
    uses: list[Use] = []
    start = rest = 0
    phase_of, inner = structure.phase_of, range(INNER[structure.shape])
    for k, phase in enumerate(phase_of):
        state.append(n)
        n += N_STATE
        gap.append(row)
        row += N_STATE
        first = row
        if k == 0:
            start, row = row, row + N_STATE
        tie.append([row + N_WRENCH * i for i in inner])
        row += N_WRENCH * len(inner)
        for i in inner:
            for group in structure.phases[phase].groups:
                uses.append(Use(group, k, i, phase, n, row))
                n += group.size
                row += n_cones(group) + n_limits(group)
        wrench.append([n + N_WRENCH * i for i in inner])
        n += N_WRENCH * len(inner)
        if k + 1 == len(phase_of) and not structure.capture_planes:
            rest, row = row, row + 3
        stage_rows.append(row - first)
    state.append(n)
    n += N_STATE
    n_end = N_CAPTURABLE + structure.capture_planes if structure.capture_planes else N_STATE
    end, row = row, row + n_end
    stage_rows.append(n_end)
    shifts = n + 2 * np.arange(structure.n_shifts)
    n += 2 * structure.n_shifts
    durations = n + np.arange(len(structure.phases) if structure.free_durations else 0)
    n += len(durations)
    total, row = row, row + (1 if structure.free_durations and structure.fixed_total else 0)
    return Layout(
        n=n,
        n_rows=row,
        state=np.array(state),
        wrench=np.array(wrench),
        uses=tuple(uses),
        durations=durations,
        shifts=shifts,
        gap=np.array(gap),
        tie=np.array(tie),
        start=start,
        rest=rest,
        end=end,
        total=total,
        stage_rows=tuple(stage_rows),
    )
