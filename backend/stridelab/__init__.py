"""Centre of mass and rolling-wheel analysis of human gait; multi-contact motion planning for humanoids."""

from importlib.metadata import version

__version__ = version("stridelab")
