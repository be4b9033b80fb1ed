"""Creates the online estimator of a stream configuration.

The smoother is imported only when used, because imports dominate the time to open a stream.
"""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from stridelab.conventions import GRAVITY_M_S2
from stridelab.errors import Fault, InvalidInput
from stridelab.estimation.complementary.online_filter import OnlineComplementaryFilter
from stridelab.estimation.complementary.transfer_functions import (
    AUTO_HIGH_HZ,
    AUTO_LOW_HZ,
    THESIS_HIGH_HZ,
    THESIS_LOW_HZ,
    require_cutoffs,
)
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.online_estimator import OnlineEstimator
from stridelab.schemas.streams import StreamConfiguration, StreamPriors, StreamReady

if TYPE_CHECKING:
    from stridelab.estimation.smoother import SmootherPriors


def begin(configuration: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    """Create the estimator, and the ``ready`` message that describes it.

    Raises ``InvalidInput`` (``cutoffs-out-of-range``, ``cutoffs-not-used``, ``ahead-not-used``, ``mass-out-of-range``).
    """
    return _BEGIN[configuration.method](configuration)


def _complementary(asked: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    if asked.ahead is not None:
        raise InvalidInput(
            "ahead-not-used",
            "The complementary filter does not use the walking direction.",
            [Fault("ahead", "not used by this method")],
        )
    if asked.cutoffs == "auto":
        low_hz, high_hz = AUTO_LOW_HZ, AUTO_HIGH_HZ
    elif asked.cutoffs == "thesis":
        low_hz, high_hz = THESIS_LOW_HZ, THESIS_HIGH_HZ
    else:
        low_hz, high_hz = asked.cutoffs
    require_cutoffs(low_hz, high_hz, asked.rate_hz)
    stated = asked.priors
    estimator = OnlineComplementaryFilter(
        low_hz=low_hz,
        high_hz=high_hz,
        mass_kg=asked.mass_kg,
        table_sd_m=stated.geometry_m,
        priors=ErrorPriors(**stated.model_dump(exclude={"geometry_m"})),
        velocity_m_s=None if asked.velocity_m_s is None else np.array(asked.velocity_m_s),
    )
    ready = StreamReady(
        method=asked.method,
        rate_hz=asked.rate_hz,
        format=asked.format,
        low_hz=low_hz,
        high_hz=high_hz,
        references=["carpentier2017thesis", "carpentier2016spectral"],
    )
    return estimator, ready


def _smoother(asked: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    from stridelab.estimation.smoother import Smoother

    if asked.cutoffs != "auto":
        raise InvalidInput(
            "cutoffs-not-used",
            "The smoother has no cut-off frequencies; only the complementary filter has.",
            [Fault("cutoffs", "not used by this method")],
        )
    estimator = Smoother(priors=smoother_priors(asked.priors, asked.mass_kg)).causal(
        mass_kg=asked.mass_kg,
        table_sd_m=asked.priors.geometry_m,
        velocity_m_s=None if asked.velocity_m_s is None else np.array(asked.velocity_m_s),
        ahead=None if asked.ahead is None else np.array([*asked.ahead, 0.0]),
    )
    references = ["carpentier2017thesis", "dejong1991", "schmidt1966"]
    ready = StreamReady(method=asked.method, rate_hz=asked.rate_hz, format=asked.format, references=references)
    return estimator, ready


def smoother_priors(stated: StreamPriors, mass_kg: float) -> "SmootherPriors":
    """Convert the priors of a stream to those of the smoother.

    A constant error of force / mass is attributed to the plates horizontally and to the mass vertically. The angular
    momentum oscillates at half the step frequency about the walking axis and at the step frequency about the lateral
    one, so its RMS is that of its rate over 2 pi f; the smoother normalises it by the weight.
    """
    from stridelab.estimation.smoother import SmootherPriors

    along, sideways, up = stated.acceleration_m_s2
    horizontal = math.hypot(along, sideways) / math.sqrt(2.0)
    about_walk, about_side = (
        rate / (2.0 * math.pi * hz * GRAVITY_M_S2)
        for rate, hz in zip(stated.momentum_rate_nm_kg, (stated.step_hz / 2.0, stated.step_hz), strict=True)
    )
    return SmootherPriors(
        marker_m=stated.marker_m,
        plate_force_n=mass_kg * horizontal,
        plate_moment_nm=stated.moment_nm,
        mass_share=up / GRAVITY_M_S2,
        clock_s=stated.clock_s,
        momentum_m_s=(about_walk, about_side),
        step_hz=stated.step_hz,
    )


_BEGIN: Final[Mapping[str, Callable[[StreamConfiguration], tuple[OnlineEstimator, StreamReady]]]] = {
    "complementary": _complementary,
    "smoother": _smoother,
}
