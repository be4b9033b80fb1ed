"""Centre of mass and rolling-wheel analysis of human gait; multi-contact motion planning for humanoids.

``import stridelab as sl`` gives the names of ``stridelab.library``, imported when they are first used.
"""

from typing import Any

import lazy_loader

_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":  # takes half of the start of a process that needs little else
        from importlib.metadata import version

        return version("stridelab")
    return _import_name(name)
