"""What the words on the page of a sweep mean: varied fields, outcomes, cost and effort."""

from collections.abc import Mapping
from typing import Final

from stridelab_web.pages.terms.term import Term

_LIMIT: Final = "/help/tutorials/robot-wing#find-the-limit"
_CHECKED: Final = "/help/contact-sequences#what-the-validation-refuses"

FIELD_TERMS: Final[Mapping[str, Term]] = {
    "stride": Term("longest distance that a foot travels in one step", _LIMIT),
    "height": Term("largest rise of a foot in one step", _LIMIT),
    "timing": Term("factor on the durations of all phases; below 1 is faster", _LIMIT),
    "friction": Term("coefficient of friction of all surfaces", "/help/theory/wrench-cones"),
}
"""Varied fields: columns of the table and axes of the charts."""
OUTCOME_TERMS: Final[Mapping[str, Term]] = {
    "feasible": Term("there is a motion, and with the whole body its certificate passed", _LIMIT),
    "refused": Term("the contacts contradict the robot or the terrain; nothing was solved", _CHECKED),
    "infeasible": Term("no motion obeys all limits, or the body cannot follow it", _LIMIT),
    "failed": Term("the computation ended with an error; nothing is known", _LIMIT),
}
"""Outcomes of a scenario."""
EFFORT_TERMS: Final[Mapping[str, Term]] = {
    "cost": Term("objective of the plan; lower is better", "/help/theory/centroidal-problem"),
    "present": Term("value of the scenario from which the sweep started", _LIMIT),
    "solve_time": Term("work of the processors for all solutions together", "/help/theory/fast-solver#figures"),
}
"""Further words of the page."""
