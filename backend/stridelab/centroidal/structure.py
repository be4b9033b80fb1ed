"""What of a problem decides the shape of its programme, and nothing else: two problems alike in it share a solver.

Contacts, durations, weights, friction and mass are numbers that a compiled programme takes as parameters. The pattern
of phases, how many intervals each has, the sizes and cones of the groups of u, the mixtures and what is left free
are its structure.
"""

from dataclasses import dataclass

from stridelab.centroidal.spline import Shape


@dataclass(frozen=True)
class Group:
    """``size`` variables of u in blocks of ``block``, one for each point; ``lorentz`` as in ``Generators``.

    ``weighed``: whether effort costs; ``limited``: whether normal forces are bounded; ``shift``: which contact
    displacement moves its points, None where they stay.
    """

    name: str
    size: int
    lorentz: int
    block: int
    weighed: bool
    limited: bool
    shift: int | None


@dataclass(frozen=True)
class Visited:
    """An effector whose log-density counts in a phase, and the displacement of its contact."""

    effector: str
    shift: int | None


@dataclass(frozen=True)
class PhaseStructure:
    """``intervals`` of a phase, the groups of u in it and the log-densities."""

    intervals: int
    groups: tuple[Group, ...]
    visited: tuple[Visited, ...]


@dataclass(frozen=True)
class Structure:
    """Equal and hashable by its contents; ``densities`` pairs effectors with the digest of their mixture.

    ``capture_planes``: half-planes for the capture point at the end; 0: the motion ends at rest. ``shape`` is that of
    the controls within an interval.
    """

    phases: tuple[PhaseStructure, ...]
    densities: tuple[tuple[str, bytes], ...]
    free_durations: bool
    fixed_total: bool
    n_shifts: int
    capture_planes: int
    shape: Shape

    @property
    def n_intervals(self) -> int:
        """Of the whole motion."""
        return sum(phase.intervals for phase in self.phases)

    @property
    def phase_of(self) -> list[int]:
        """The phase of every interval."""
        return [i for i, phase in enumerate(self.phases) for _ in range(phase.intervals)]
