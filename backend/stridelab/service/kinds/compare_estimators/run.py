"""``compare-estimators``: compares all estimators on one recording with the ground truth, or else with physical laws.

Tables: ``comparison`` (the estimates over the window), ``spectra`` (amplitude densities of the errors of inputs and
estimators), ``contributions`` (of each input to the complementary filter, figure 2.7), ``bode`` (figure 2.5).
"""

from pathlib import Path
from typing import Any, Final

import numpy as np

from stridelab.conventions import Series
from stridelab.estimation.complementary.contributions import bode_responses, split_contributions
from stridelab.estimation.complementary.filter import ComplementaryFilter
from stridelab.estimation.evaluation.comparison import Comparison, ComparisonData
from stridelab.pipelines.compare_estimators import compare_estimators
from stridelab.pipelines.estimate_com import build_estimator
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.comparison import CompareEstimatorsInput, CompareEstimatorsTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import track_columns, write_table

_BODE_HZ: Final = (0.01, 400)


def run(task: CompareEstimatorsTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Compare on ``task.recording``; the summary is a ``CompareEstimatorsSummary``.

    Raises as ``stridelab.pipelines.compare_estimators.compare_estimators`` does.
    """
    result = compare_estimators(task, folder, progress)
    progress(0.9, "writing the result")
    summary = result.summary.model_dump(mode="json")
    provenance = {"file": task.recording.filename, "frame": "world, z up", "summary": summary}
    artifacts = _write_tables(folder, task.input, result.data, result.comparison, provenance)
    progress(1.0, "done")
    return Outcome(summary, result.citation_keys, artifacts)


def _write_tables(
    folder: Path, request: CompareEstimatorsInput, data: ComparisonData, found: Comparison, provenance: dict[str, Any]
) -> tuple[ArtifactFile, ...]:
    first = next(iter(found.assessments.values()))
    tracks: dict[str, Series] = {"time_s": first.estimate.time_s}
    if data.truth is not None:
        start = int(np.argmin(np.abs(data.geometric.time_s - first.estimate.time_s[0])))
        tracks |= track_columns("truth_{}_m", data.truth.com_m[start : start + len(first.estimate.time_s)])
    spectra: dict[str, Series] = {"frequency_hz": first.spectrum.frequency_hz}
    for name, spectrum in found.inputs.items():
        unit = "m_s2_rthz" if name == "force" else "m_rthz"
        spectra |= track_columns(f"input_{name}_{{}}_{unit}", spectrum.amplitude_density)
    for name, assessment in found.assessments.items():
        tracks |= track_columns(f"{_column_name(name)}_{{}}_m", assessment.estimate.com_m)
        spectra |= track_columns(f"{_column_name(name)}_{{}}_m_rthz", assessment.spectrum.amplitude_density)
    tables = {"comparison": tracks, "spectra": spectra, **_filter_tables(request, data)}
    return tuple(file for stem, columns in tables.items() for file in write_table(folder, stem, columns, provenance))


def _filter_tables(request: CompareEstimatorsInput, data: ComparisonData) -> dict[str, dict[str, Series]]:
    """Figures 2.7 and 2.5 for the requested complementary filter."""
    chosen = build_estimator(ComplementaryFilter.name, request)
    if not isinstance(chosen, ComplementaryFilter):
        raise TypeError("the estimator of that name is the complementary filter")
    signals = chosen.input_signals(data.geometric, data.wrench, data.mass_kg)
    parts, within = split_contributions(signals.filters, signals.inputs), signals.stretch.within
    shares: dict[str, Series] = {"time_s": data.geometric.time_s[signals.span.inside]}
    for name in ("geometry", "force", "axis", "total"):
        shares |= track_columns(f"{name}_{{}}_m", getattr(parts, f"{name}_m")[within])
    low_hz, lines = _BODE_HZ
    response = bode_responses(signals.filters, np.geomspace(low_hz, 0.499 * signals.span.rate_hz, lines))
    curves: dict[str, Series] = {"frequency_hz": response.frequency_hz}
    for branch, name in enumerate(("geometry", "force", "axis")):
        curves[f"{name}_gain_db"] = response.gain_db[:, branch]
        curves[f"{name}_phase_rad"] = response.phase_rad[:, branch]
    return {"contributions": shares, "bode": curves}


def _column_name(name: str) -> str:
    return name.replace("-", "_")
