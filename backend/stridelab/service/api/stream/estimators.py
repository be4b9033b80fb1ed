"""Which online estimator a configuration asks for. Without scipy: a stream opens in the time that its imports take."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from stridelab.estimation.cutoffs import AUTO_HIGH_HZ, AUTO_LOW_HZ, THESIS_HIGH_HZ, THESIS_LOW_HZ, require_cutoffs
from stridelab.estimation.error_priors import ErrorPriors
from stridelab.estimation.online import OnlineEstimator
from stridelab.estimation.online_complementary import OnlineComplementaryFilter
from stridelab.schemas.streams import StreamConfiguration, StreamReady


def begin(configuration: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
    """The estimator, and what a client is told of it.

    Raises ``InvalidInput`` (``cutoffs-out-of-range``, ``mass-out-of-range``).
    """
    return _BEGIN[configuration.method](configuration)


def _complementary(asked: StreamConfiguration) -> tuple[OnlineEstimator, StreamReady]:
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


_BEGIN: Final[Mapping[str, Callable[[StreamConfiguration], tuple[OnlineEstimator, StreamReady]]]] = {
    "complementary": _complementary,
}
