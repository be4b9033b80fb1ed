"""The script around the grid: stored results are not computed again, and the table agrees with them."""

import runpy
from pathlib import Path
from typing import Any

import pytest

from experiments.climbing_grid import CaseResult, GridReport, climbing_cases
from stridelab.wholebody.certificate.certificate import Check

SCRIPT = Path(__file__).parents[2] / "scripts" / "make_climbing_grid.py"


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(SCRIPT))


@pytest.fixture
def report() -> GridReport:
    """All succeed but the first, which has a check to keep."""
    first, *others = climbing_cases()
    drift = Check("contact_drift_max", 0.02, "m", 1e-3, False, 3, "left_foot", 1.5)
    results = [
        CaseResult(first.name, first.kind, "certificate", "drift | far", 18, (0.7, 0.9), (drift,), False, 0.2, 1.0),
        *(CaseResult(case.name, case.kind, None, replayed=True) for case in others),
    ]
    return GridReport("uniform", tuple(results))


def test_stored_results_are_read_back_and_not_computed_again(
    script: dict[str, Any], report: GridReport, tmp_path: Path
) -> None:
    (tmp_path / "uniform.json").write_bytes(script["REPORTS"].dump_json(report))
    assert script["grid"]("uniform", tmp_path, 1) == report


def test_the_table_counts_and_names_what_failed(script: dict[str, Any], report: GridReport) -> None:
    lines = script["table"]([report]).splitlines()
    rails, stairs = (sum(case.kind == kind for case in climbing_cases()) for kind in ("rail", "stairs"))
    counts = f"| uniform | {rails - 1} of {rails} | {stairs} of {stairs} |"
    assert lines[2] == f"{counts} {rails + stairs - 1} of {rails + stairs} | certificate 1 |"
    assert f"| {climbing_cases()[0].name} | certificate: drift / far |" in lines
    assert lines.count(f"| {climbing_cases()[-1].name} | yes |") == 1
