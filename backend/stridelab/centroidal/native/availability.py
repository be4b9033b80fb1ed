"""Availability of the C++ solver (``backend/native``): exact cones, milliseconds without a warm start.

The solver is optional; without it CasADi solves the same problems more slowly. ``stridelab_native`` is imported from
the installed packages or from the folder in ``STRIDELAB_NATIVE_PATH``, which the build scripts set.
"""

import os
import sys
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final

from stridelab.centroidal.free_variables import movable_spans
from stridelab.centroidal.point_forces import Pyramids
from stridelab.centroidal.problem import CentroidalProblem

MODULE: Final = "stridelab_native"
PATH_VARIABLE: Final = "STRIDELAB_NATIVE_PATH"
"""Environment variable with the folder that contains the package."""
INTERFACE: Final = 8
"""Required interface number of the module; a different number belongs to an incompatible build."""

MAX_MOVABLE_PER_PHASE: Final = 4
"""Maximum number of movable contacts in one phase."""


@dataclass(frozen=True, eq=False)
class NativeSolver:
    """The imported module."""

    module: ModuleType


@dataclass(frozen=True)
class NativeUnavailable:
    """The solver is not available; ``reason`` is a sentence."""

    reason: str


@cache
def native_availability() -> NativeSolver | NativeUnavailable:
    """The solver, or why it is not available; imported once per process."""
    folder = os.environ.get(PATH_VARIABLE)
    if folder and Path(folder).is_dir() and folder not in sys.path:
        sys.path.append(folder)
    try:
        module = import_module(MODULE)
    except ModuleNotFoundError:
        return NativeUnavailable("the C++ solver has not been built here.")
    except ImportError as failure:
        return NativeUnavailable(f"the installed C++ solver does not load: {str(failure).splitlines()[0]}.")
    if getattr(module, "INTERFACE", None) != INTERFACE:
        return NativeUnavailable("the installed C++ solver belongs to another version; build it again.")
    return NativeSolver(module)


def unsupported_features(problem: CentroidalProblem) -> str | None:
    """Features of a problem that the C++ solver does not support, as a phrase; None if it supports all."""
    moved = problem.placements is not None
    features = [
        ("pyramids in place of friction cones", isinstance(problem.control, Pyramids)),
        ("densities of velocity and rates", bool(problem.state_densities)),
        ("free placements and continuous forces at once", moved and problem.shape == "cubic"),
        ("free placements and durations at once", moved and problem.durations is not None),
        ("free placements of more than four contacts at once", moved and has_too_many_movable_contacts(problem)),
        ("free placements and the limbs' momentum at once", moved and problem.limbs_nm is not None),
    ]
    unsupported = [name for name, used in features if used]
    return ", ".join(unsupported) or None


def has_too_many_movable_contacts(problem: CentroidalProblem) -> bool:
    """Whether more contacts may be moved in one phase than the solver supports."""
    spans = movable_spans(problem.sequence)
    phases = range(len(problem.sequence.phases))
    return any(sum(span.first <= i <= span.last for span in spans) > MAX_MOVABLE_PER_PHASE for i in phases)


def native_can_solve(problem: CentroidalProblem) -> bool:
    """Whether the solver is available and supports the problem."""
    return unsupported_features(problem) is None and isinstance(native_availability(), NativeSolver)
