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


def create_estimator(configuration: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    """Create the estimator, and the ``ready`` message that describes it.

    Raises ``InvalidInput`` (``cutoffs-out-of-range``, ``cutoffs-not-used``, ``ahead-not-used``, ``mass-out-of-range``).
    """
    return _FACTORIES[configuration.method](configuration)


def _create_complementary(configuration: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    if configuration.ahead is not None:
        raise InvalidInput(
            "ahead-not-used",
            "The complementary filter does not use the walking direction.",
            [Fault("ahead", "not used by this method")],
        )
    if configuration.cutoffs == "auto":
        low_hz, high_hz = AUTO_LOW_HZ, AUTO_HIGH_HZ
    elif configuration.cutoffs == "thesis":
        low_hz, high_hz = THESIS_LOW_HZ, THESIS_HIGH_HZ
    else:
        low_hz, high_hz = configuration.cutoffs
    require_cutoffs(low_hz, high_hz, configuration.rate_hz)
    stated = configuration.priors
    estimator = OnlineComplementaryFilter(
        low_hz=low_hz,
        high_hz=high_hz,
        mass_kg=configuration.mass_kg,
        table_sd_m=stated.geometry_m,
        priors=ErrorPriors(**stated.model_dump(exclude={"geometry_m"})),
        velocity_m_s=None if configuration.velocity_m_s is None else np.array(configuration.velocity_m_s),
    )
    ready = StreamReady(
        method=configuration.method,
        rate_hz=configuration.rate_hz,
        format=configuration.format,
        low_hz=low_hz,
        high_hz=high_hz,
        references=["carpentier2017thesis", "carpentier2016spectral"],
    )
    return estimator, ready


def _create_smoother(configuration: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    from stridelab.estimation.smoother import Smoother

    if configuration.cutoffs != "auto":
        raise InvalidInput(
            "cutoffs-not-used",
            "The smoother has no cut-off frequencies; only the complementary filter has.",
            [Fault("cutoffs", "not used by this method")],
        )
    estimator = Smoother(priors=smoother_priors(configuration.priors, configuration.mass_kg)).causal(
        mass_kg=configuration.mass_kg,
        table_sd_m=configuration.priors.geometry_m,
        velocity_m_s=None if configuration.velocity_m_s is None else np.array(configuration.velocity_m_s),
        ahead=None if configuration.ahead is None else np.array([*configuration.ahead, 0.0]),
    )
    references = ["carpentier2017thesis", "dejong1991", "schmidt1966"]
    ready = StreamReady(
        method=configuration.method, rate_hz=configuration.rate_hz, format=configuration.format, references=references
    )
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


_FACTORIES: Final[Mapping[str, Callable[[StreamConfiguration], tuple[OnlineEstimator, StreamReady]]]] = {
    "complementary": _create_complementary,
    "smoother": _create_smoother,
}
