"""Turn the report of pytest-benchmark into one Markdown table; usage: bench_table.py REPORT.json."""

import json
import sys
from pathlib import Path


def seconds(value: float) -> str:
    """A duration with three significant digits and a fitting unit."""
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("us", 1e6)):
        if value * scale >= 1:
            return f"{value * scale:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def table(report: dict) -> str:
    """The report's benchmarks, grouped, with whatever each one measured beside its time."""
    machine = report["machine_info"]
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench`; compare the rows of one run, not runs of different machines.",
        f"Python {machine['python_version']}, {machine['cpu'].get('brand_raw', machine['machine'])}.",
        "",
        "| benchmark | median | spread (IQR) | rounds | measured |",
        "| --- | --- | --- | --- | --- |",
    ]
    for bench in sorted(report["benchmarks"], key=lambda b: (b["group"] or "", b["fullname"])):
        stats, extra = bench["stats"], bench["extra_info"]
        measured = ", ".join(f"{key} {value}" for key, value in extra.items())
        name = bench["name"].removeprefix("test_").replace("_", " ")
        lines.append(
            f"| {name} | {seconds(stats['median'])} | {seconds(stats['iqr'])} | {stats['rounds']} | {measured} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(table(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))))
