"""Figure 2.6: error spectra of the three inputs, on which the choice of the cut-offs is based (2.5.2)."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import Progress
from stridelab.dynamics.wrench import Wrench
from stridelab.estimation.complementary.forward_backward import filter_inputs
from stridelab.estimation.evaluation.error_spectra import ErrorSpectrum, crossing_hz, error_spectrum
from stridelab.reproduction.claims import Claim, Measured, Reproduction, at_least, at_most, reproduces, within
from stridelab.reproduction.common.intervals import resampled_interval
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.reproduction.studies.estimator_study import simulate_trial
from stridelab.simulation.robot.walker import RATE_HZ

LOW_HZ, HIGH_HZ, TOP_HZ = 0.4, 4.0, 90.0
SEGMENT_S: Final = 8.0
"""Nearly the whole walk, so that a constant error leaks into one spectral line (0.125 Hz) only."""
INPUTS: Final = ("geometry", "force", "axis")
_UNITS: Final = {"geometry": "m", "force": "m_s2", "axis": "m"}
Bands = Float[np.ndarray, "3 3"]
"""RMS error in the low, middle and high band (rows) per axis (columns)."""


@reproduces("fig-2.6", "Spectra of the errors of the three inputs", draws="many", default_seeds=3)
def run(seeds: range, tell: Progress) -> Reproduction:
    """Mean power spectra over one draw per seed of the thesis' noise, and the spectrum of the axis without noise."""
    noisy = []
    for k, seed in enumerate(seeds):
        tell(k / (len(seeds) + 1), f"walk {k + 1} of {len(seeds)}")
        noisy.append(_error_spectra("thesis", seed))
    mean = {name: _mean_spectrum([one[name] for one in noisy]) for name in INPUTS}
    tell(len(seeds) / (len(seeds) + 1), "a walk without noise")
    clean = _error_spectra("none", 0)["axis"]
    bands = {name: _band_rms(spectrum) for name, spectrum in mean.items()}
    return Reproduction(
        claims=_spectrum_claims(noisy, clean),
        note=f"Walk at the robot's cadence, noise of 2.5.1, {len(seeds)} draws. Figure 2.3 is confirmed horizontally.",
        tables={"spectra": _spectrum_columns(mean, clean), "bands": _band_columns(bands)},
        drawing=render_svg(*_spectrum_panels(mean)),
        references=("carpentier2017thesis", "carpentier2016spectral", "stasse2017talos"),
    )


def _spectrum_claims(noisy: Sequence[Mapping[str, ErrorSpectrum]], clean: ErrorSpectrum) -> tuple[Claim, ...]:
    """Claims on the mean spectra of the draws; ``clean`` is that of the axis without noise."""

    def mean_of(name: str, chosen: Sequence[int]) -> ErrorSpectrum:
        return _mean_spectrum([noisy[k][name] for k in chosen])

    def middle_over_ends(chosen: Sequence[int]) -> float:
        bands = _band_rms(mean_of("geometry", chosen))
        low, mid, high = np.hypot(bands[:, 0], bands[:, 1]).tolist()
        return float(mid / min(low, high))

    def force_high(chosen: Sequence[int]) -> float:
        bands = _band_rms(mean_of("force", chosen))
        return float((bands[2] ** 2 / (bands**2).sum(axis=0)).min())

    def no_noise(chosen: Sequence[int]) -> float:
        # L' about the lateral axis displaces the central axis along the walk, independently of sensor noise.
        return float(_band_rms(clean)[1, 0] / _band_rms(mean_of("axis", chosen))[1, 0])

    def first_crossing_hz(chosen: Sequence[int]) -> float:
        axis_error, geometry = mean_of("axis", chosen), mean_of("geometry", chosen)
        return min(crossing_hz(axis_error, geometry, axis) for axis in (0, 1))

    def height_difference(chosen: Sequence[int]) -> float:
        axis_error, geometry = (_band_rms(mean_of(name, chosen))[0, 2] for name in ("axis", "geometry"))
        return float(np.abs(axis_error / geometry - 1.0))

    every, n = range(len(noisy)), len(noisy)
    return (
        Measured("geometry_middle_over_ends", "very clean", middle_over_ends(every), "1", at_most(0.5, "ours")).says(
            "the geometry has errors at low and high frequencies, and is very clean between (horizontally)",
            "Horizontal RMS error between 0.4 and 4 Hz over the smaller of those below 0.4 Hz and above 4 Hz.",
            interval=resampled_interval(middle_over_ends, n),
        ),
        Measured("force_power_above_4_hz", 1.0, force_high(every), "1", at_least(0.9, "ours")).says(
            "the error of the force lies in high frequencies",
            "Smallest share of the power of an axis above 4 Hz.",
            interval=resampled_interval(force_high, n),
        ),
        Measured("axis_without_noise", 1.0, no_noise(every), "1", at_least(0.7, "ours")).says(
            "the error of the axis comes from L', independent of the added noise",
            "Its RMS error between 0.4 and 4 Hz along the walk with perfect sensors and model, over that with noise.",
            interval=resampled_interval(no_noise, n),
        ),
        Measured("axis_worse_from_hz", 0.4, first_crossing_hz(every), "Hz", within(0.2, 1.2, "ours")).says(
            "the axis is reliable only below 0.4 Hz",
            "Lowest frequency at which the horizontal error of the axis exceeds that of the geometry; the spectral "
            "lines are 0.125 Hz apart.",
            interval=resampled_interval(first_crossing_hz, n),
            comparator="geometry",
        ),
        Measured("axis_height_over_geometry", "unlikely", height_difference(every), "1", at_most(0.05, "ours")).says(
            "no input gives a precise height (2.3)",
            "Vertically the axis only repeats the geometry, projected along the force: below 0.4 Hz its error equals "
            "the geometry's up to this relative difference. It is no independent measurement.",
            interval=resampled_interval(height_difference, n),
            comparator="geometry",
        ),
    )


def _error_spectra(noise: str, seed: int) -> dict[str, ErrorSpectrum]:
    trial = simulate_trial("robot", noise, seed)
    total = Wrench(trial.wrench.force_n, trial.wrench.moment_nm)
    inputs = filter_inputs(trial.geometric.com_m, total, trial.mass_kg)
    c = trial.truth.com_m
    errors = {
        "geometry": inputs.geometry_m - c,
        "force": inputs.acceleration_m_s2 - trial.truth.acceleration_m_s2,
        "axis": inputs.axis_point_m - c,
    }
    return {name: error_spectrum(error, RATE_HZ, SEGMENT_S) for name, error in errors.items()}


def _mean_spectrum(spectra: Sequence[ErrorSpectrum]) -> ErrorSpectrum:
    return ErrorSpectrum(spectra[0].frequency_hz, np.mean([s.density for s in spectra], axis=0))


def _band_rms(spectrum: ErrorSpectrum) -> Bands:
    edges = ((0.0, LOW_HZ), (LOW_HZ, HIGH_HZ), (HIGH_HZ, TOP_HZ))
    return np.array([spectrum.band_rms(low, high) for low, high in edges])


def _spectrum_columns(mean: dict[str, ErrorSpectrum], clean: ErrorSpectrum) -> dict[str, np.ndarray]:
    columns = {"frequency_hz": clean.frequency_hz}
    for name, spectrum in (*mean.items(), ("axis_without_noise", clean)):
        unit = _UNITS.get(name, "m")
        columns |= {f"{name}_{axis}_{unit}_rthz": spectrum.amplitude_density[:, k] for k, axis in enumerate("xyz")}
    return columns


def _band_columns(bands: dict[str, Bands]) -> dict[str, np.ndarray]:
    columns = {"from_hz": np.array([0.0, LOW_HZ, HIGH_HZ]), "to_hz": np.array([LOW_HZ, HIGH_HZ, TOP_HZ])}
    for name, values in bands.items():
        columns |= {f"{name}_{axis}_{_UNITS[name]}": values[:, k] for k, axis in enumerate("xyz")}
    return columns


def _spectrum_panels(mean: dict[str, ErrorSpectrum]) -> list[Panel]:
    titles = {
        "geometry": ("Error of the geometry", "amplitude (m/√Hz)"),
        "force": ("Error of the acceleration from the force", "amplitude (m/s²/√Hz)"),
        "axis": ("Error of the projection on the central axis", "amplitude (m/√Hz)"),
    }
    return [
        Panel(
            title,
            "frequency (Hz)",
            unit,
            [Curve(mean[k].frequency_hz, mean[k].amplitude_density[:, j], "xyz"[j], j) for j in range(3)],
            log_x=True,
            log_y=True,
        )
        for k, (title, unit) in titles.items()
    ]
