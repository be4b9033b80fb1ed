"""Inverse optimal control of (4.20): the weights with which it predicts how people walk (Mombaur et al. 2010).

The lower level solves (4.20) between the ends of recorded steps, with the person's contacts and durations; the upper
level chooses the ratios of the weights of

    w_c |c''|^2 + w_L |L_c' / (m h)|^2 - w_p sum_i log p_i(c) + w_f sum |f / (m g)|^2

that minimise the mean square distance of the planned from the estimated centre of mass, over a grid. m is the mass and
h the height of the centre of mass of the person, so that both rates are accelerations and one set of weights fits
people and robots of any size. Only ratios of weights determine a motion. The grid contains the weights 0 (``FAINT``):
each term is also judged by what is lost without it. The last term is our regulariser, the others are (4.20a).

Weights are chosen on all people but one and judged on that one, person by person.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.centroidal.problem import CentroidalProblem, Weights
from stridelab.centroidal.solver import solve
from stridelab.conventions import Progress
from stridelab.reproduction.common.intervals import Interval, rms_ratio
from stridelab.reproduction.studies.recorded_motions import RecordedMotion

FAINT: Final = 1e-3
"""Weight of what is left out: of the accelerations and the forces it makes plans unique."""


@dataclass(frozen=True)
class TermWeights:
    """Weights of the terms; ``momentum_rate`` that of ``|L_c' / (m h)|^2``, in 1 / (m/s^2)^2 like the first one."""

    com_acceleration: float = FAINT
    momentum_rate: float = 0.0
    likelihood: float = 0.0
    force: float = FAINT

    def of_body(self, mass_kg: float, height_m: float) -> Weights:
        """The same weights for a body of this mass and height of its centre of mass (m)."""
        return Weights(
            com_acceleration=self.com_acceleration,
            momentum_rate=self.momentum_rate / (mass_kg * height_m) ** 2,
            likelihood=self.likelihood,
            surface_force=self.force,
        )


THESIS: Final = Weights(surface_force=FAINT)
"""Weights of section 4.5.1, which are the defaults but for the forces: the same numbers for every body."""
COMPARATORS: Final[Mapping[str, TermWeights | Weights]] = {
    "the thesis' weights": THESIS,
    "stridelab's defaults": Weights(),
    "equal weights": TermWeights(1.0, 1.0, 1.0, 1.0),
    "accelerations alone": TermWeights(com_acceleration=1.0),
    "momentum rates alone": TermWeights(momentum_rate=1.0),
    "densities alone": TermWeights(likelihood=1.0),
    "forces alone": TermWeights(force=1.0),
}
"""Weights that no data chose."""
GRID: Final = tuple(
    TermWeights(*weights)
    for weights in product(
        (FAINT, 1.0),
        (0.0, *np.logspace(0.0, 4.0, 9).tolist()),
        (0.0, 0.01, 0.1, 1.0),
        (FAINT, 1.0, 10.0, 100.0, 1000.0),
    )
)
"""Candidates of the upper level."""
PARTS: Final = {"distance": (0, 1, 2), "horizontal": (0, 1), "vertical": (2,), "force": (3, 4, 5)}
"""Columns of ``Errors`` by what they measure."""


@dataclass(frozen=True)
class PredictionError:
    """Mean square errors per axis (ahead, left, up) of a plan: of the centre of mass (m^2), of the force (m g)^2.

    The latter over the intervals in which all force is measured.
    """

    com_m2: tuple[float, float, float]
    force_share2: tuple[float, float, float]

    @property
    def distance_m2(self) -> float:
        """Mean square distance of the centre of mass."""
        return float(np.sum(self.com_m2))


def weighted(problem: CentroidalProblem, height_m: float, weights: TermWeights | Weights) -> CentroidalProblem:
    """The problem with these weights; ``height_m`` is that of the centre of mass."""
    of_body = weights if isinstance(weights, Weights) else weights.of_body(problem.mass_kg, height_m)
    return replace(problem, weights=of_body)


def prediction_error(motion: RecordedMotion, weights: TermWeights | Weights) -> PredictionError:
    """Errors of the plan with these weights; NaN where the solver does not converge."""
    plan = solve(weighted(motion.problem, motion.height_m, weights))
    if not plan.converged:
        return PredictionError((float("nan"),) * 3, (float("nan"),) * 3)
    force_n = np.sum([f.sum(axis=1) for f in plan.forces_n.values()], axis=0)
    share = (force_n - motion.force_n)[motion.measured] / motion.problem.weight_n
    return PredictionError(_squares(plan.com_m - motion.com_m), _squares(share))


def _squares(errors: Float[np.ndarray, "n 3"]) -> tuple[float, float, float]:
    x, y, z = np.mean(errors**2, axis=0).tolist()
    return x, y, z


Errors = Float[np.ndarray, "people candidates 6"]
"""Mean square errors of every person (mean of their motions) and candidate: three of the centre of mass, then force."""


def errors_of_people(
    motions: Sequence[RecordedMotion], candidates: Sequence[TermWeights | Weights], tell: Progress
) -> tuple[tuple[str, ...], Errors]:
    """Names of the people, in order, and the errors of all candidates."""
    rows: dict[str, list[list[tuple[float, ...]]]] = {}
    for k, motion in enumerate(motions):
        tell(k / len(motions), f"step pair {k + 1} of {len(motions)}")
        found = [prediction_error(motion, weights) for weights in candidates]
        rows.setdefault(motion.person, []).append([(*e.com_m2, *e.force_share2) for e in found])
    people = tuple(sorted(rows))
    return people, np.array([np.mean(rows[person], axis=0) for person in people])


def best_candidate(errors: Errors, part: str = "distance") -> int:
    """The candidate with the smallest mean square error over the people; never one that fails on a motion."""
    return int(np.nanargmin(errors[..., PARTS[part]].sum(axis=-1).mean(axis=0)))


def held_out_errors(errors: Errors, part: str = "distance") -> tuple[list[int], Float[np.ndarray, "people 6"]]:
    """Per person, the candidate that is best for all others in one of ``PARTS``, and its errors on that person.

    Raises ``ValueError`` for fewer than two people.
    """
    n = len(errors)
    if n < 2:
        raise ValueError("Weights cannot be judged on other people than those of the fit: there is only one.")
    chosen = [best_candidate(np.delete(errors, k, axis=0), part) for k in range(n)]
    return chosen, errors[np.arange(n), chosen]


def without_term(candidates: Sequence[TermWeights], term: str) -> list[int]:
    """Indices of the candidates that leave a term (a field of ``TermWeights``) out."""
    return [k for k, weights in enumerate(candidates) if getattr(weights, term) <= FAINT]


def error_ratio(
    errors: Float[np.ndarray, "people 6"], other: Float[np.ndarray, "people 6"], part: str
) -> tuple[float, Interval | None]:
    """RMS error of one prediction over that of another, and its 95 % interval over the people."""
    one, two = (of[:, PARTS[part]].sum(axis=1) for of in (errors, other))
    return rms_ratio(one, two)
