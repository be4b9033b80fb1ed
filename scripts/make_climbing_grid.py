"""Try densities of the CoM on the grid of rails and stairs, and keep what came of it.

    make_climbing_grid.py DENSITIES...                 names of measures, or files that hold a card
    make_climbing_grid.py uniform card.json --out DIR  one JSON file per choice of densities, in DIR
    make_climbing_grid.py --table DIR/*.json           only the table in Markdown of results that are kept

Results that are in DIR already are not computed again unless ``--anew`` is given.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

from pydantic import TypeAdapter

from experiments.climbing_grid import CaseResult, GridReport, climbing_cases, run_grid
from stridelab.reachability.card import Measure
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_proxies, read_card
from stridelab.robots.loader import load_robot

ROBOT = "talos"
REPORTS: TypeAdapter[GridReport] = TypeAdapter(GridReport)


def main() -> None:
    """Read the command line, run, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("densities", nargs="*", metavar="DENSITIES")
    parser.add_argument("--out", type=Path, default=Path(".data") / "climbing-grid", metavar="DIR")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--anew", action="store_true", help="compute again what is there")
    parser.add_argument("--table", type=Path, nargs="+", default=[], metavar="FILE")
    arguments = parser.parse_args()
    reports = [REPORTS.validate_json(path.read_bytes()) for path in arguments.table]
    reports += [grid(name, arguments.out, arguments.processes, anew=arguments.anew) for name in arguments.densities]
    sys.stdout.write(table(reports) + "\n")


def grid(densities: str, folder: Path, processes: int, *, anew: bool = False) -> GridReport:
    """The report of one choice of densities, kept in ``folder`` after every case."""
    label = Path(densities).stem
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{label}.json"
    known: dict[str, CaseResult] = {}
    if path.is_file() and not anew:
        known = {result.case: result for result in REPORTS.validate_json(path.read_bytes()).results}
    cases = climbing_cases()

    def keep(result: CaseResult) -> None:
        known[result.case] = result
        sys.stderr.write(f"{label}: {result.case}: {result.stage or 'success'} {result.reason}\n")
        report = GridReport(label, tuple(known[case.name] for case in cases if case.name in known))
        path.write_bytes(REPORTS.dump_json(report, indent=1))

    run_grid(load_robot(ROBOT), proxies(densities), [c for c in cases if c.name not in known], processes, keep)
    return GridReport(label, tuple(known[case.name] for case in cases))


def proxies(densities: str) -> Mapping[str, Proxy]:
    """Densities of a card in a file, or those that come with the package."""
    for measure in get_args(Measure):
        if measure == densities:
            return load_proxies(ROBOT, measure)
    return {name: effector.to_proxy() for name, effector in read_card(Path(densities)).effectors.items()}


def table(reports: list[GridReport]) -> str:
    """Counts of all choices, then case by case, in Markdown."""
    by_name = [{result.case: result for result in report.results} for report in reports]
    rows = [
        "| densities | rails | stairs | replayed | failed at |",
        "|---|---|---|---|---|",
        *(_counts(report) for report in reports),
        "",
        "| case | " + " | ".join(report.label for report in reports) + " |",
        "|---" * (1 + len(reports)) + "|",
        *(
            f"| {case.name} | " + " | ".join(_cell(known.get(case.name)) for known in by_name) + " |"
            for case in climbing_cases()
        ),
    ]
    return "\n".join(rows)


def _counts(report: GridReport) -> str:
    rails, stairs = report.of_kind("rail"), report.of_kind("stairs")
    failed = ", ".join(f"{stage} {n}" for stage, n in report.failures_by_stage.items()) or "-"
    shares = " | ".join(f"{part.n_successes} of {len(part.results)}" for part in (rails, stairs))
    return f"| {report.label} | {shares} | {report.n_replayed} of {len(report.results)} | {failed} |"


def _cell(result: CaseResult | None) -> str:
    if result is None:
        return ""
    return "yes" if result.succeeded else f"{result.stage}: {result.reason}".replace("|", "/")


if __name__ == "__main__":
    main()
