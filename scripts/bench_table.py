"""Turn the report of pytest-benchmark into a page: what fell, what meets its aim, then all rows.

Usage: bench_table.py REPORT.json AIMS.toml BEFORE.md
"""

import json
import re
import statistics
import sys
import tomllib
from pathlib import Path
from typing import Any

UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
CHANGED = 1.3
"""Ratio of medians, the machine's own change divided out, from which a row is listed: the same rows of two quiet runs
differ by up to a quarter."""
ROW = re.compile(
    r"\| (?P<name>[^|]+) \| (?P<median>[\d.]+) (?P<unit>s|ms|us|ns) \| [^|]+ \| \d+ \| (?P<extra>[^|]*) \|"
)


def format_duration(duration_s: float) -> str:
    """A duration with three significant digits and a fitting unit."""
    for unit in ("s", "ms", "us"):
        if duration_s >= UNITS_S[unit]:
            return f"{duration_s / UNITS_S[unit]:.3g} {unit}"
    return f"{duration_s * 1e9:.3g} ns"


def list_rows(report: dict[str, Any]) -> list[str]:
    """The report's benchmarks, grouped, with whatever each one measured beside its time."""
    lines = []
    for bench in sorted(report["benchmarks"], key=lambda b: (b["group"] or "", b["fullname"])):
        stats = bench["stats"]
        measured = ", ".join(f"{key} {value}" for key, value in bench["extra_info"].items())
        name = bench["name"].removeprefix("test_").replace("_", " ")
        times = f"{format_duration(stats['median'])} | {format_duration(stats['iqr'])}"
        lines.append(f"| {name} | {times} | {stats['rounds']} | {measured} |")
    return lines


def read_rows(lines: list[str]) -> dict[str, tuple[float, dict[str, str]]]:
    """Median in s and measured values of each row of a table, by name."""
    rows = {}
    for match in filter(None, map(ROW.fullmatch, lines)):
        pairs = (pair.rsplit(" ", 1) for pair in match["extra"].strip().split(", ") if " " in pair)
        rows[match["name"]] = float(match["median"]) * UNITS_S[match["unit"]], dict(pairs)
    return rows


def compare_tables(now: list[str], before: list[str]) -> list[str]:
    """Rows whose median changed by more than the machine did, as ratios of times; and rows of one table only."""
    new, old = read_rows(now), read_rows(before)
    ratio = {name: new[name][0] / old[name][0] for name in new.keys() & old.keys()}
    if not ratio:
        return ["No row of the table before has the name of one of these."]
    machine = statistics.median(ratio.values())
    changed = sorted(((r / machine, name) for name, r in ratio.items()), reverse=True)
    slower = [f"| {name} | {r:.2f} |" for r, name in changed if r > CHANGED]
    faster = [f"| {name} | {r:.2f} |" for r, name in reversed(changed) if r < 1 / CHANGED]
    removed, added = sorted(old.keys() - new.keys()), len(new.keys() - old.keys())
    shared = f"{len(ratio)} rows stand in both tables; the median of their ratios, {machine:.2f}, is the machine's own"
    counts = f"{len(slower)} rows became slower and {len(faster)} faster by more than a factor of {CHANGED}"
    return [
        f"{shared} and divided out.",
        f"{counts}; {added} are new, {len(removed)} are gone{': ' + ', '.join(removed) if removed else ''}.",
        *(["", "| benchmark | time now / before |", "| --- | --- |", *slower, *faster] if slower or faster else []),
    ]


def check_aims(now: list[str], aims: list[dict[str, Any]]) -> list[str]:
    """A row for each aim: its bound, what was measured, and by which factor it is met (above 1) or missed.

    Raises:
        KeyError: If an aim names a benchmark or a value that is not in the table.
    """
    rows = read_rows(now)
    lines = ["| aim | benchmark | bound | measured | margin |", "| --- | --- | --- | --- | --- |"]
    for aim in aims:
        median_s, extra = rows[aim["benchmark"]]
        value = median_s if aim["value"] == "median_s" else float(extra[aim["value"]])
        bound, least = (aim["at_least"], True) if "at_least" in aim else (aim["at_most"], False)
        margin = value / bound if least else bound / value
        sign = ">=" if least else "<="
        verdict = f"{margin:.2f}, {'met' if margin >= 1 else '**missed**'}"
        bounded = f"{aim['value']} {sign} {bound:g}"
        lines.append(f"| {aim['what']} | {aim['benchmark']} | {bounded} | {value:.3g} | {verdict} |")
    return lines


def write_page(report: dict[str, Any], aims: list[dict[str, Any]], before: str) -> str:
    """The whole page, for a report of pytest-benchmark and the page before."""
    machine, rows = report["machine_info"], list_rows(report)
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`; compare the rows of one run, not runs of different machines.",
        f"Python {machine['python_version']}, {machine['cpu'].get('brand_raw', machine['machine'])}.",
        "",
        "## Aims",
        "",
        "Bounds are our own aims (`tests/bench/aims.toml`); the margin is the factor by which one is met.",
        "",
        *check_aims(rows, aims),
        "",
        "## Compared with the table before",
        "",
        *compare_tables(rows, before.splitlines()),
        "",
        "## All rows",
        "",
        "| benchmark | median | spread (IQR) | rounds | measured |",
        "| --- | --- | --- | --- | --- |",
        *rows,
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    report_file, aims_file, before_file = map(Path, sys.argv[1:])
    aims_given = tomllib.loads(aims_file.read_text(encoding="utf-8"))["aim"]
    timings = json.loads(report_file.read_text(encoding="utf-8"))
    sys.stdout.write(write_page(timings, aims_given, before_file.read_text(encoding="utf-8")))
