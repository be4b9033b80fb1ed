"""Measures of gait from the centre of mass: margins of stability, steps, work, energy exchange, angular momentum."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
