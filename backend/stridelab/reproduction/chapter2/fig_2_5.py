"""Figure 2.5: Bode diagrams of H1, s^2 H2 and H3 with f_1 = 4 Hz and f_2 = 0.4 Hz."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.estimation.complementary.contributions import Bode, bode_responses
from stridelab.estimation.complementary.transfer_functions import (
    AUTO_HIGH_HZ,
    AUTO_LOW_HZ,
    THESIS_HIGH_HZ,
    THESIS_LOW_HZ,
    complementary_filters,
)
from stridelab.reproduction.claims import Measured, Reproduction, at_most, reproduces, within
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg

RATE_HZ: Final = 1000.0
FREQUENCY_HZ: Final = np.geomspace(0.01, 100.0, 1000)
HALF_DB: Final = 20.0 * float(np.log10(0.5))
RIPPLE: Final = 10.0 ** (3.0 / 20.0)
"""Usual definition of a pass band: gain within 3 dB of one."""
_NAMES: Final = ("H1", "s² H2", "H3")


@reproduces("fig-2.5", "Bode diagrams of the three filters")
def run(seeds: range, tell: Progress) -> Reproduction:
    """Frequency responses in closed form."""
    tell(0.1, "computing the responses")
    thesis = bode_responses(complementary_filters(THESIS_LOW_HZ, THESIS_HIGH_HZ, RATE_HZ), FREQUENCY_HZ)
    ours = bode_responses(complementary_filters(AUTO_LOW_HZ, AUTO_HIGH_HZ, RATE_HZ), FREQUENCY_HZ)
    gain = np.abs(thesis.response)
    at_cutoffs = bode_responses(
        complementary_filters(THESIS_LOW_HZ, THESIS_HIGH_HZ, RATE_HZ), np.array([THESIS_LOW_HZ, THESIS_HIGH_HZ])
    )
    sum_error = float(np.abs(thesis.response.sum(axis=1) - 1.0).max())
    at_f2, at_f1 = float(at_cutoffs.gain_db[0, 2]), float(at_cutoffs.gain_db[1, 1])
    peak, ten_hz = float(gain[:, 0].max()), float(np.interp(10.0, FREQUENCY_HZ, gain[:, 0]))
    half = within(HALF_DB - 0.05, HALF_DB + 0.05, "words")
    claims = (
        Measured("sum_error", 0.0, sum_error, "1", at_most(1e-12, "words")).says("H1 + s² H2 + H3 = 1 (definition 2)"),
        Measured("h1_gain_at_0_01_hz", "small", float(gain[0, 0]), "1", at_most(0.06, "ours")).says(
            "H1 acts as a band-pass in [f2, f1]: nothing at the lowest frequencies"
        ),
        Measured("h1_peak", 1.0, peak, "1", within(1.0 / RIPPLE, RIPPLE, "ours")).says(
            "H1 acts as a band-pass in [f2, f1]",
            f"Its peak gain is {peak:.3f} and its roll-off is of first order: at 10 Hz a share of "
            f"{ten_hz:.2f} of the marker noise passes. This explains the high-frequency noise observed in 2.5.4.",
        ),
        Measured("gain_at_f2_db", "cut-off", at_f2, "dB", half).says(
            "f2 is the cut-off of H3",
            "Two equal poles: half the amplitude (-6 dB) at the named frequency; the -3 dB frequency is lower.",
        ),
        Measured("gain_at_f1_db", "cut-off", at_f1, "dB", half).says("f1 is the cut-off of s² H2", "-6 dB, as above."),
    )
    return Reproduction(
        claims=claims,
        note="The curves agree with the figure. H1 is described as a band-pass; its peak gain exceeds 1 and its "
        "roll-off is slow. The default cut-offs of stridelab (0.2 and 1 Hz) are in the table and dashed in the "
        "drawing.",
        tables={"bode": _bode_columns("thesis", thesis) | _bode_columns("auto", ours)},
        drawing=render_svg(*_bode_panels(thesis, ours)),
        references=("carpentier2017thesis", "carpentier2016spectral"),
    )


def _bode_columns(name: str, response: Bode) -> dict[str, np.ndarray]:
    columns = {"frequency_hz": response.frequency_hz}
    for branch, label in enumerate(("h1", "s2h2", "h3")):
        columns[f"{name}_{label}_gain_db"] = response.gain_db[:, branch]
        columns[f"{name}_{label}_phase_rad"] = response.phase_rad[:, branch]
    return columns


def _bode_panels(thesis: Bode, ours: Bode) -> tuple[Panel, Panel]:
    def _curves_of(values: str, scale: float = 1.0) -> list[Curve]:
        f = thesis.frequency_hz
        return [
            Curve(
                f, np.maximum(scale * getattr(design, values)[:, k], -80.0 if scale == 1.0 else -720.0), label, k, dash
            )
            for design, dash, end in ((thesis, False, ""), (ours, True, ", ours"))
            for k, label in enumerate(name + end for name in _NAMES)
        ]

    return (
        Panel("Gain", "frequency (Hz)", "gain (dB)", _curves_of("gain_db"), log_x=True),
        Panel("Phase", "frequency (Hz)", "phase (degrees)", _curves_of("phase_rad", 180.0 / np.pi), log_x=True),
    )
