"""The fast solver in C++ (``backend/native``), where it is built: exact cones, cold in milliseconds.

It is no dependency: nothing is lost without it but time. ``stridelab_native`` is looked for among the installed
packages, then in the folder that ``STRIDELAB_NATIVE_PATH`` names, which the scripts set that build it.
"""

import os
import sys
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

from stridelab.centroidal.free_variables import movable
from stridelab.centroidal.point_forces import Pyramids
from stridelab.centroidal.problem import CentroidalProblem

MODULE: Final = "stridelab_native"
FOLDER: Final = "STRIDELAB_NATIVE_PATH"
"""Environment variable that names the folder in which the package lies."""
INTERFACE: Final = 4
"""What the module must say of itself; another number is another build's."""

MOVED_AT_ONCE: Final = 4
"""Contacts that may be moved in one phase."""


@dataclass(frozen=True, eq=False)
class Native:
    """The module."""

    module: ModuleType


@dataclass(frozen=True)
class Missing:
    """Why it is not there, as a sentence."""

    reason: str


@cache
def availability() -> Native | Missing:
    """The solver, or why there is none; looked for once."""
    folder = os.environ.get(FOLDER)
    if folder and Path(folder).is_dir() and folder not in sys.path:
        sys.path.append(folder)
    try:
        module = import_module(MODULE)
    except ModuleNotFoundError:
        return Missing("the C++ solver has not been built here.")
    except ImportError as failure:
        return Missing(f"the C++ solver that was found does not load: {str(failure).splitlines()[0]}.")
    if getattr(module, "INTERFACE", None) != INTERFACE:
        return Missing("the C++ solver that was found belongs to another version; it must be built anew.")
    return Native(module)


def lacks(problem: CentroidalProblem) -> str | None:
    """What of a problem the C++ solver does not do, as a phrase; None where it does all of it."""
    moved = problem.placements is not None
    wants = [
        ("pyramids in place of friction cones", isinstance(problem.control, Pyramids)),
        ("free placements and continuous forces at once", moved and problem.shape == "cubic"),
        ("free placements and durations at once", moved and problem.durations is not None),
        ("free placements of more than four contacts at once", moved and crowded(problem)),
        ("free placements and the limbs' momentum at once", moved and problem.limbs_nm is not None),
    ]
    missing = [words for words, wanted in wants if wanted]
    return ", ".join(missing) or None


def crowded(problem: CentroidalProblem) -> bool:
    """Whether more contacts may be moved in one phase than the solver has room for."""
    stays = movable(problem.sequence)
    phases = range(len(problem.sequence.phases))
    return any(sum(stay.first <= i <= stay.last for stay in stays) > MOVED_AT_ONCE for i in phases)


def serves(problem: CentroidalProblem) -> bool:
    """Whether it is there and does all that the problem wants."""
    return lacks(problem) is None and isinstance(availability(), Native)
