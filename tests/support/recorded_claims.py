"""What verdicts stand on, as recorded: our number, the thesis', the range and whose it is, n, interval and comparator,
and the numbers of its remark; of the tables, the mean size of every column.

A changed truth, comparator, threshold or sample is noticed here even where it leaves the verdict as it was. After a
change that is meant, ``STRIDELAB_RECORD_CLAIMS=1 pytest tests/reproduction tests/studies`` records anew; the difference
of the file then shows what has moved.
"""

import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, Final

import numpy as np

from stridelab.reproduction.claims import Claim, Column
from support.flipped_verdicts import assert_flips
from support.recorded_steps import Steps, step_differences

RECORDS: Final = Path(__file__).parents[1] / "reproduction" / "recorded_claims.json"
BOOK: Final = Path(__file__).parents[2] / "docs" / "reproduction.md"
STEPS: Final = RECORDS.with_name("recorded_steps.json")
FIELDS: Final = ("verdict", "thesis", "holds_from", "holds_to", "strict", "threshold", "aim", "evidence", "n", "where",
                 "interval", "comparator", "solver", "cases_inside", "no_interval")  # fmt: skip
MEASURED_TIMES: Final = ("time", "u_c_faster", "per_second", "iteration_", "u_c_gain", "u_f_", "horizon_hz",
                         "kernel_ns", "wrench_25_s", "forces_17_s")  # fmt: skip
"""Beginnings of the keys of claims on processor times, whose numbers and verdicts are those of a machine."""
ROUNDING: Final = 1e-7
"""Numbers below it are rounding errors of what is exact: their size is not compared."""
RELATIVE: Final = 2e-3
"""Room for other processors and libraries; one machine repeats every digit."""
STEPS_RELATIVE: Final = 2e-4
"""The same for the numbers on the way to claims, which are not rounded: two machines differed by 2e-6 at most."""
EXACT: Final = ("thesis", "holds_from", "holds_to")
"""Fields that no computation of ours enters: a bound that is off by a thousandth is another bound."""
EXACT_RELATIVE: Final = 1e-12
"""Room for the last digit of a product; a bound that is as small as rounding errors is compared as well."""
COMPUTED_BOUND: Final = re.compile(r"excess_nats$|rise_nats$")
"""Claims whose bound is a standard error of a learned density, which other processors do not repeat in every digit."""
DIGITS: Final = 9
MACHINE_COLUMN: Final = re.compile(r"seconds|_ms$|ms_per|iterations|solver$|_l_[xyz]_nms$|margin_n$|violation$")
"""Columns of times, of how a solver got there, and of what is zero but for its tolerance."""
NUMBER: Final = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def assert_as_recorded(name: str, claims: Iterable[Claim], *, timed: bool = False) -> None:
    """Every claim of an item has the fields of its record; times of a machine only if ``timed`` (they are invented).

    Its verdict flips at the bounds (``assert_flips``).
    """
    claims = list(claims)
    assert_flips(claims)
    _compare_or_record(name, {claim.key: _record_of(name, claim, timed=timed) for claim in claims})


def _compare_or_record(name: str, now: Mapping[str, Mapping[str, Any]]) -> None:
    recorded = _records(RECORDS).get(name)
    changed = [f"{name} is not recorded: docs/tests.md"] if recorded is None else _claim_differences(now, recorded)
    if changed and os.environ.get("STRIDELAB_RECORD_CLAIMS"):
        _record(RECORDS, name, now)
    else:
        assert not changed, "\n".join(changed)


def _claim_differences(now: Mapping[str, Mapping[str, Any]], recorded: Mapping[str, Mapping[str, Any]]) -> list[str]:
    if now.keys() != recorded.keys():
        return [f"claims are {', '.join(now)}, recorded {', '.join(recorded)}"]
    return [
        f"{key}: {field} is {one}, recorded {recorded[key].get(field)}"
        for key, record in now.items()
        for field, one in record.items()
        if _differ(one, recorded[key].get(field), _room(key, field))
    ]


def _records(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def _record(file: Path, name: str, now: Mapping[str, Any]) -> None:
    """Replace the record of an item or test; those of others stay as they are, byte for byte."""
    records = dict(sorted((_records(file) | {name: now}).items()))
    rows = (f" {json.dumps(item)}: {{\n{_lines_of(of)}\n }}" for item, of in records.items())
    file.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")


def assert_steps_as_recorded(name: str, steps: Steps) -> None:
    """The numbers between models and claims are as recorded; a new test has no record before it is recorded."""
    recorded = _records(STEPS).get(name)
    changed = [f"{name} is not recorded: docs/tests.md"]
    if recorded is not None:
        changed = step_differences(steps, recorded, STEPS_RELATIVE)
    elif "::" in name and not os.environ.get("STRIDELAB_RECORD_CLAIMS"):
        return
    if changed and os.environ.get("STRIDELAB_RECORD_CLAIMS"):
        _record(STEPS, name, steps)
    else:
        assert not changed, "\n".join(changed)


def assert_tables_as_recorded(name: str, tables: Mapping[str, Mapping[str, Column]]) -> None:
    """The mean size of every column of an item's tables is as recorded, but for times and iterations."""
    sizes = {
        f"{table}.{column}": _mean_size(values)
        for table, columns in tables.items()
        for column, values in columns.items()
        if not MACHINE_COLUMN.search(column)
    }
    _compare_or_record(f"{name}, tables", {"mean sizes": sizes})


def assert_note_as_in_book(name: str, note: str) -> None:
    """Words and numbers of an item's note are those of its section in the book, numbers to their last digit."""
    _, _, section = BOOK.read_text(encoding="utf-8").partition(f"\n## {name}: ")
    printed = section.split("\n\n")[1]
    assert NUMBER.sub("#", printed).startswith(NUMBER.sub("#", note)), printed
    pairs = zip(NUMBER.findall(note), NUMBER.findall(printed), strict=False)  # the page adds how often an item draws
    assert [pair for pair in pairs if _printed_differ(*pair)] == [], printed


def _mean_size(values: Column) -> float | str:
    """Mean of the absolute finite values; of texts, their number and that of different ones."""
    if values.dtype.kind not in "fiub":
        return f"{len(values)} texts, {len(set(values.tolist()))} different"
    finite = np.abs(values.astype(float))[np.isfinite(values.astype(float))]
    return _rounded(float(finite.mean())) if len(finite) else "no number"


def _lines_of(records: Mapping[str, Mapping[str, Any]]) -> str:
    return ",\n".join(f"  {json.dumps(key)}: {json.dumps(record)}" for key, record in records.items())


def _record_of(name: str, claim: Claim, *, timed: bool) -> dict[str, Any]:
    fields = {field: getattr(claim, field) for field in FIELDS}
    if fields["interval"] is not None:
        fields["interval"] = [_rounded(end) for end in fields["interval"]]
    if name in ("table-4.1", "numbers-4") and not timed and claim.key.startswith(MEASURED_TIMES):
        return {field: value for field, value in fields.items() if field != "verdict"}
    return {"ours": _rounded(claim.ours)} | fields | {"remark": NUMBER.findall(claim.note)}


def _room(key: str, field: str) -> float:
    return EXACT_RELATIVE if field in EXACT and not COMPUTED_BOUND.search(key) else RELATIVE


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _differ(one: Any, other: Any, relative: float = RELATIVE) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) != len(other) or any(map(_differ, one, other))
    if isinstance(one, str) and isinstance(other, str) and NUMBER.fullmatch(one) and NUMBER.fullmatch(other):
        return _printed_differ(one, other)
    if not isinstance(one, float) or not isinstance(other, (int, float)):
        return bool(one != other)
    size = max(abs(one), abs(other))
    return (size >= ROUNDING or relative == EXACT_RELATIVE) and not math.isclose(one, other, rel_tol=relative)


def _printed_differ(one: str, other: str) -> bool:
    """Whether two printed numbers differ by more than the last digit of either, beyond ``RELATIVE``."""
    digit = max(10.0 ** int(Decimal(text).as_tuple().exponent) for text in (one, other))
    a, b = float(one), float(other)
    return abs(a - b) > 1.01 * digit and _differ(a, b)
