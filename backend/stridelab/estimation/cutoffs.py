"""Cut-off frequencies of the complementary filter: f_2 of the central axis (low) and f_1 of the force (high), in Hz."""

from typing import Final

from stridelab.errors import Fault, InvalidInput

THESIS_LOW_HZ: Final = 0.4
THESIS_HIGH_HZ: Final = 4.0
AUTO_LOW_HZ: Final = 0.2
AUTO_HIGH_HZ: Final = 1.0
"""What measurements on windows of one or two steps justify (docs/theory/complementary-filter.md)."""


def require_cutoffs(low_hz: float, high_hz: float, rate_hz: float) -> None:
    """Raise ``InvalidInput`` (``cutoffs-out-of-range``) unless 0 < low < high < half the rate."""
    if not 0 < low_hz < high_hz < rate_hz / 2:
        raise InvalidInput(
            "cutoffs-out-of-range",
            f"Cutoffs of {low_hz:g} and {high_hz:g} Hz do not fit a rate of {rate_hz:g} Hz: "
            "0 < low < high < half the rate is needed.",
            [Fault("cutoffs", f"{low_hz:g} and {high_hz:g} Hz")],
        )
