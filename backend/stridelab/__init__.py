"""Centre of mass and rolling-wheel analysis of human gait; multi-contact motion planning for humanoids.

``import stridelab as sl`` gives the names of ``stridelab.library``, imported when they are first used.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("stridelab")

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
