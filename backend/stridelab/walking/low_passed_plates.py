"""Plates whose force was low-passed before it was stored: by how much the load that they show precedes the strike.

A zero-phase low-pass spreads the steep onset of a strike to both sides, so that the stored load begins before the foot
lands. Such a force contains no noise: between 60 and 100 Hz the derivative of its vertical component is 70 to 100 dB
below that between 2 and 5 Hz, in a force as measured 8 to 43 dB. How strong the filter was is seen from 15 to 30 Hz.

The lead is that of 110 stances on unfiltered plates of nine laboratories, filtered here by Butterworth filters of
second and fourth order forward and backward, at 8 to 20 Hz, with and without a dead band of 50 N
(``scripts/make_low_pass_lead.py``). Linear extrapolation of the load above 50 N then precedes the strike by 12 ms at
-40 dB and by 0.65 ms more for each dB below.
"""

from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.recordings.plate_contacts import loaded_intervals
from stridelab.recordings.recording import Plate

NOISE_BAND_HZ, FILTER_BAND_HZ, GAIT_BAND_HZ = (60.0, 100.0), (15.0, 30.0), (2.0, 5.0)
LEAST_NOISE_DB: Final = -55.0
"""Power in the band of the noise, relative to that of gait, below which the force was low-passed."""
LEAD_S, LEAD_AT_DB, LEAD_S_PER_DB = 0.012, -40.0, 0.00065
"""Lead of a low-passed onset: its value at ``LEAD_AT_DB``, and its increase per dB below."""
MAX_LEAD_S: Final = 0.03
LEAD_SD_S: Final = 0.005
"""Standard deviation of the lead of one strike, over stances and filters."""
FILTERED_LOAD_N: Final = 50.0
"""Load from which a low-passed onset is extrapolated; dead bands of stored forces end near it."""
DEAD_BAND_N: Final = 40.0
"""First stored load from which the force has a dead band."""
BEFORE_S: Final = (0.06, 0.03)
EXACT_SHARE: Final = 1e-4
"""A plate without dead band whose load between these times before a strike is below this share of its threshold is
simulated: its force has no noise, but was not low-passed."""
_STANCE_S: Final = (0.35, 2.0)
LEAST_PEAK_N: Final = 150.0
"""Peak load of a stance of which the spectrum is taken."""
_INNER: Final = (0.05, 0.95)
"""Part of a stance whose spectrum is taken: without the onset and the end, where a dead band has edges."""


def low_pass_lead_s(plate: Plate, rate_hz: float) -> float | None:
    """Time by which the stored load of ``plate`` precedes a strike; None if its force was not low-passed."""
    if rate_hz < 2.5 * NOISE_BAND_HZ[1]:
        return None
    last = len(plate.force_n) - 1
    load = np.linalg.norm(plate.force_n, axis=1)
    found = []
    for start_s, end_s in loaded_intervals(plate, rate_hz):
        i, j = round(start_s * rate_hz), round(end_s * rate_hz)
        before = load[max(0, i - round(BEFORE_S[0] * rate_hz)) : max(0, i - round(BEFORE_S[1] * rate_hz))]
        is_stance = _STANCE_S[0] < end_s - start_s < _STANCE_S[1] and load[i:j].max() > LEAST_PEAK_N
        is_exact = load[i] < DEAD_BAND_N and float(before.max(initial=0.0)) < plate.threshold_n * EXACT_SHARE
        if i > 0 and j < last and is_stance and not is_exact:
            m = j - i
            up_n = plate.force_n[i + round(_INNER[0] * m) : i + round(_INNER[1] * m), 2]
            found.append(band_powers_db(up_n, rate_hz))
    if not found:
        return None
    noise_db, filter_db = np.median(found, axis=0)
    if noise_db > LEAST_NOISE_DB:
        return None
    return float(np.clip(LEAD_S + LEAD_S_PER_DB * (LEAD_AT_DB - filter_db), 0.0, MAX_LEAD_S))


def band_powers_db(up_n: Series, rate_hz: float) -> tuple[float, float]:
    """Power of the derivative of a vertical force in the bands of noise and of filters, relative to that of gait."""
    rate_n = np.diff(up_n)
    power = np.abs(np.fft.rfft(rate_n * np.hanning(len(rate_n)))) ** 2
    frequency_hz = np.fft.rfftfreq(len(rate_n), 1.0 / rate_hz)

    def mean_db(band_hz: tuple[float, float]) -> float:
        inside = (frequency_hz >= band_hz[0]) & (frequency_hz < band_hz[1])
        return float(10.0 * np.log10(power[inside].mean() + np.finfo(float).tiny))

    gait_db = mean_db(GAIT_BAND_HZ)
    return mean_db(NOISE_BAND_HZ) - gait_db, mean_db(FILTER_BAND_HZ) - gait_db
