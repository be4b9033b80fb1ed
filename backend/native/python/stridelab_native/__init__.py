"""The centroidal solver in C++ (see docs/theory/fast-solver.md), and the rows of the whole body."""

from stridelab_native._native import INTERFACE, BodyRows, Problem, __version__, problem, reduced_level

__all__ = ["INTERFACE", "BodyRows", "Problem", "__version__", "problem", "reduced_level"]
