"""The centroidal solver in C++ (see docs/theory/fast-solver.md)."""

from stridelab_native._native import INTERFACE, Problem, __version__, problem

__all__ = ["INTERFACE", "Problem", "__version__", "problem"]
