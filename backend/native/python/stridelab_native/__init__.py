"""The centroidal solver in C++ (see docs/theory/fast-solver.md), and the rows of the whole body."""

from stridelab_native._native import INTERFACE, AvoidanceRows, BodyRows, Problem, __version__, problem, reduced_level

__all__ = ["INTERFACE", "AvoidanceRows", "BodyRows", "Problem", "__version__", "problem", "reduced_level"]
