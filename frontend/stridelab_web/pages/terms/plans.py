"""What the values on the page of a plan mean: optimal control, costs, stages, replay."""

from collections.abc import Mapping
from typing import Final

from stridelab_web.pages.terms.term import Term

_PROBLEM: Final = "/help/theory/centroidal-problem"
_CONTROL: Final = f"{_PROBLEM}#the-control"
_SOLVER: Final = "/help/theory/fast-solver#the-iteration"
_REPLAY: Final = "/help/theory/whole-body#replay-in-physics"

PLAN_TERMS: Final[Mapping[str, Term]] = {
    "objective": Term("sum of the weighted costs below; lower is better", _PROBLEM),
    "solver": Term("program that found the motion of the centre of mass", _SOLVER),
    "iterations": Term("how often the solver improved its motion", _SOLVER),
    "solve_time_s": Term("time from the first guess to the solution", "/help/theory/fast-solver#figures"),
    "build_time_s": Term("time to set up the equations before solving", _SOLVER),
    "formulation": Term("what the solver chooses: the forces of the contacts, or their sum, the wrench", _CONTROL),
    "node_rate_hz": Term("instants per second at which the motion is solved", f"{_PROBLEM}#the-grid"),
    "kkt_error": Term("how far the solution is from an exact optimum; 0 is exact", _SOLVER),
    "duration_s": Term("how long the planned motion takes", f"{_PROBLEM}#free-durations-and-contacts"),
}
"""Values under *Optimal control*, by field of the summary."""

REPLAY_TERMS: Final[Mapping[str, Term]] = {
    "com_error_max_m": Term("largest distance of the simulated centre of mass from the plan", _REPLAY),
    "com_error_rms_m": Term("typical distance of the simulated centre of mass from the plan", _REPLAY),
    "foot_slip_max_m": Term("how far a foot slides while it should rest", _REPLAY),
    "landing_error_max_m": Term("how far a foot lands from its planned place", _REPLAY),
    "hand_force_mean_n": Term("mean force between hands and rail while they hold it", _REPLAY),
    "torque_ratio_max": Term("largest torque of a joint; 1 is its limit", _REPLAY),
    "collisions": Term("pairs of parts that meet in the simulation and should not", _REPLAY),
}
"""Values under *Replay in physics*, by field of the replay."""

STAGE_TERMS: Final[Mapping[str, Term]] = {
    "check": Term(
        "contacts are checked before anything is solved", "/help/contact-sequences#what-the-validation-refuses"
    ),
    "reachability": Term("places that the centre of mass can reach are read", "/help/theory/reachability"),
    "centroidal": Term("motion and forces of the centre of mass are solved", _PROBLEM),
    "whole body": Term("joints follow the centre of mass, instant by instant", "/help/theory/whole-body#the-hierarchy"),
    "certificate": Term("the motion is checked against limits", "/help/theory/whole-body#the-certificate"),
    "replay": Term("the motion is run in a physics simulation", _REPLAY),
    "export": Term("the files of the result are written", "/help/file-formats"),
}
"""Rows under *Time per stage*."""

_TERMS_OF_COST: Final = f"{_PROBLEM}#terms-and-margins-added-to-the-thesis-problem"
_DENSITY: Final = "log_density_"
COST_TERMS: Final[Mapping[str, Term]] = {
    "com_acceleration": Term("how much the centre of mass speeds up and slows down", _PROBLEM),
    "momentum_rate": Term("how much the body is turned by its contacts", _PROBLEM),
    "surface_force": Term("how large the forces under the feet are", _TERMS_OF_COST),
    "point_force": Term("how large the forces of the hands are", _TERMS_OF_COST),
    _DENSITY: Term("how unusual the place of the centre of mass is for this contact", "/help/theory/proxy"),
}
"""Rows under *Cost of the motion*; the densities of all effectors are one entry."""
COST_COLUMNS: Final[Mapping[str, Term]] = {
    "integral": Term("the term, summed over the motion", _PROBLEM),
    "weight": Term("factor that makes the terms comparable, in seconds", _PROBLEM),
    "cost": Term("integral times weight", _PROBLEM),
}
"""Columns under *Cost of the motion*."""


def cost_term(key: str) -> Term | None:
    """The explanation of a term of the cost; None for one of another version."""
    return COST_TERMS.get(_DENSITY if key.startswith(_DENSITY) else key)
