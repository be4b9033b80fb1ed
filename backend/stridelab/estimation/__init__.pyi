from .complementary.filter import ComplementaryFilter as ComplementaryFilter
from .complementary.online_filter import OnlineComplementaryFilter as OnlineComplementaryFilter
from .error_priors import ErrorPriors as ErrorPriors
from .estimator import ComEstimate as ComEstimate
from .estimator import ComEstimator as ComEstimator
from .evaluation.comparison import Assessment as Assessment
from .evaluation.comparison import Comparison as Comparison
from .evaluation.comparison import KnownMotion as KnownMotion
from .evaluation.comparison import compare as compare
from .evaluation.error_spectra import error_spectrum as error_spectrum
from .evaluation.physics_residuals import force_residual_n as force_residual_n
from .evaluation.truth_errors import TruthError as TruthError
from .evaluation.truth_errors import truth_error as truth_error
from .kalman.filter import KalmanFilter as KalmanFilter
from .kalman.filter import RtsSmoother as RtsSmoother
from .latency import Latency as Latency
from .latency import estimate_latency as estimate_latency
from .markers_only import GeometryOnly as GeometryOnly
from .online_estimator import OnlineEstimator as OnlineEstimator
from .quality.assessment import Quality as Quality
from .quality.assessment import assess_quality as assess_quality
from .smoother.estimator import Smoother as Smoother
from .smoother.noise_levels import SmootherPriors as SmootherPriors

__all__ = [
    "Assessment",
    "ComEstimate",
    "ComEstimator",
    "Comparison",
    "ComplementaryFilter",
    "ErrorPriors",
    "GeometryOnly",
    "KalmanFilter",
    "KnownMotion",
    "Latency",
    "OnlineComplementaryFilter",
    "OnlineEstimator",
    "Quality",
    "RtsSmoother",
    "Smoother",
    "SmootherPriors",
    "TruthError",
    "assess_quality",
    "compare",
    "error_spectrum",
    "estimate_latency",
    "force_residual_n",
    "truth_error",
]
