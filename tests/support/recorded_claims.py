"""What verdicts stand on, as recorded: our number, the thesis', the range and whose it is, n, interval and comparator.

A changed truth, comparator, threshold or sample is noticed here even where it leaves the verdict as it was. After a
change that is meant, ``STRIDELAB_RECORD_CLAIMS=1 pytest tests/reproduction tests/studies`` records anew; the difference
of the file then shows what has moved.
"""

import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from stridelab.reproduction.claims import Claim

RECORDS: Final = Path(__file__).parents[1] / "reproduction" / "recorded_claims.json"
FIELDS: Final = ("verdict", "thesis", "holds_from", "holds_to", "strict", "threshold", "aim", "evidence", "n", "where",
                 "interval", "comparator", "solver")  # fmt: skip
MEASURED_TIMES: Final = ("time", "u_c_faster", "per_second", "iteration_", "u_c_gain", "u_f_", "horizon_hz",
                         "kernel_ns", "wrench_25_s", "forces_17_s")  # fmt: skip
"""Beginnings of the keys of claims on processor times, whose numbers and verdicts are those of a machine."""
ROUNDING: Final = 1e-7
"""Numbers below it are rounding errors of what is exact: their size is not compared."""
RELATIVE: Final = 2e-3
"""Room for other processors and libraries; one machine repeats every digit."""
DIGITS: Final = 9


def assert_as_recorded(name: str, claims: Iterable[Claim], *, timed: bool = False) -> None:
    """Every claim of an item has the fields of its record; times of a machine only if ``timed`` (they are invented)."""
    now = {claim.key: _record_of(name, claim, timed=timed) for claim in claims}
    records = json.loads(RECORDS.read_text(encoding="utf-8")) if RECORDS.exists() else {}
    if os.environ.get("STRIDELAB_RECORD_CLAIMS"):
        records = dict(sorted((records | {name: now}).items()))
        rows = (f" {json.dumps(item)}: {{\n{_lines_of(of)}\n }}" for item, of in records.items())
        RECORDS.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
        return
    assert now.keys() == records[name].keys()
    changed = [
        f"{key}: {field} is {one}, recorded {records[name][key].get(field)}"
        for key, record in now.items()
        for field, one in record.items()
        if _differ(one, records[name][key].get(field))
    ]
    assert not changed, "\n".join(changed)


def _lines_of(records: Mapping[str, Mapping[str, Any]]) -> str:
    return ",\n".join(f"  {json.dumps(key)}: {json.dumps(record)}" for key, record in records.items())


def _record_of(name: str, claim: Claim, *, timed: bool) -> dict[str, Any]:
    fields = {field: getattr(claim, field) for field in FIELDS}
    if fields["interval"] is not None:
        fields["interval"] = [_rounded(end) for end in fields["interval"]]
    if name in ("table-4.1", "numbers-4") and not timed and claim.key.startswith(MEASURED_TIMES):
        return {field: value for field, value in fields.items() if field != "verdict"}
    return {"ours": _rounded(claim.ours)} | fields


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _differ(one: Any, other: Any) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) != len(other) or any(map(_differ, one, other))
    if not isinstance(one, float) or not isinstance(other, (int, float)):
        return bool(one != other)
    return max(abs(one), abs(other)) >= ROUNDING and not math.isclose(one, other, rel_tol=RELATIVE)
