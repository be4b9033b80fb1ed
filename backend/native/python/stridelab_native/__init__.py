"""The centroidal solver in C++ (see docs/theory/fast-solver.md)."""

from stridelab_native._native import __version__

__all__ = ["__version__"]
