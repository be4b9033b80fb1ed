"""Fixed-interval smoother with coloured errors: horizontally ten times closer than the filter of section 2.4."""

from stridelab.estimation.smoother.estimator import Smoother
from stridelab.estimation.smoother.noise_levels import SmootherPriors

__all__ = ["Smoother", "SmootherPriors"]
