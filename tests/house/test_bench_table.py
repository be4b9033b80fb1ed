"""The page of benchmarks says what fell and what misses its aim."""

import importlib.util
import tomllib

import pytest

from support.docs.book import ROOT

SPEC = importlib.util.spec_from_file_location("bench_table", ROOT / "scripts" / "bench_table.py")
assert SPEC
assert SPEC.loader
bench_table = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(bench_table)


def rows(**medians_s: float) -> list[str]:
    report = [
        {
            "group": None,
            "name": f"test_{name}",
            "fullname": name,
            "extra_info": {"samples_per_s": round(10.0 / median_s)},
            "stats": {"median": median_s, "iqr": 0.1 * median_s, "rounds": 5},
        }
        for name, median_s in medians_s.items()
    ]
    return bench_table.list_rows({"benchmarks": report})


def test_times_are_compared_relative_to_the_machine():
    before = rows(a=0.1, b=0.02, c=3.0, d=4e-6, gone=1.0)
    now = rows(a=0.2, b=0.04, c=12.0, d=8e-6, new=1.0)
    listed = bench_table.compare_tables(now, before)
    assert listed[-1] == "| c | 2.00 |"
    assert listed[1].startswith("1 rows became slower and 0 faster")
    assert "1 are new, 1 are gone: gone." in listed[1]


def test_an_aim_is_met_or_missed_by_a_factor():
    table = rows(a=0.1)
    aims = [
        {"what": "fast", "benchmark": "a", "value": "samples_per_s", "at_least": 50},
        {"what": "short", "benchmark": "a", "value": "median_s", "at_most": 0.05},
    ]
    fast, short = bench_table.check_aims(table, aims)[2:]
    assert fast.endswith("| 2.00, met |")
    assert short.endswith("| 0.50, **missed** |")
    with pytest.raises(KeyError):
        bench_table.check_aims(table, [{**aims[0], "benchmark": "no such row"}])


def test_every_aim_names_a_row_of_the_page():
    aims = tomllib.loads((ROOT / "tests" / "bench" / "aims.toml").read_text(encoding="utf-8"))["aim"]
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8").splitlines()
    assert len(bench_table.check_aims(page, aims)) == len(aims) + 2


def test_the_speeds_of_the_kalman_filters_are_those_of_the_benchmarks():
    """One source: the theory page repeats the last table with two digits."""
    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8").splitlines()
    rates = {name: float(extra["samples_per_s"]) for name, (_, extra) in bench_table.read_rows(page).items()
             if "samples_per_s" in extra}  # fmt: skip
    measured = {
        "filter": ("kalman filter[1800]", "kalman filter[200000]", "estimate with its band[kalman]"),
        "smoother": ("rts smoother[1800]", "rts smoother[200000]", "estimate with its band[rts]"),
        "textbook loop": ("textbook kalman and rts loop for comparison[1800]",),
    }
    theory = (ROOT / "docs" / "theory" / "kalman-filter.md").read_text(encoding="utf-8")
    for name, benchmarks in measured.items():
        cells = [f"{rates[benchmark]:.1e}".replace("e+0", "e") for benchmark in benchmarks]
        assert f"| {name} | {' | '.join(cells)} |" in theory, name
