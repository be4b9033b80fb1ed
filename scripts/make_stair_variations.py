"""Carry out random stairs, search at other paces and places where one is refused, and write what came of it as a page.

make_stair_variations.py            all that is not stored yet, then docs/theory/stair-variations.md
make_stair_variations.py --anew     computes again; --page only writes the page
make_stair_variations.py --number 6 only so many of them
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from pydantic import TypeAdapter

from experiments.stair_variations import (
    NUMBER,
    STAIRS,
    SearchResult,
    Variation,
    random_variations,
    run_variation,
    search_alternatives,
)

PAGE = Path(__file__).resolve().parent.parent / "docs" / "theory" / "stair-variations.md"
INTRO = """# Random stairs

Written by `scripts/make_stair_variations.py`. These are {number} of {all_number} random flights of {stairs} stairs for
TALOS (`scripts/experiments/stair_variations.py`, seed 0), each 5 to 15 cm high, 30 to 36 cm deep, with a toe gap of 50
to 60 mm, and with all durations 0.8 to 1.2 times those of experiments 2 and 3 of the thesis. Every other flight has a
rail, 0.70 to 1.00 m above the footholds and 0.42 to 0.58 m to the right, with the hand 0.10 to 0.35 m ahead. Each
flight is planned with the settings of the service, followed by the whole-body controller, checked by the certificate
and replayed in the physics simulation.
"""
REPORTS: TypeAdapter[list[SearchResult]] = TypeAdapter(list[SearchResult])


def main() -> None:
    """Read the command line, run one after the other, write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(".data") / "stair-variations.json", metavar="FILE")
    parser.add_argument("--number", type=int, default=NUMBER)
    parser.add_argument("--anew", action="store_true", help="compute stored results again")
    parser.add_argument("--page", action="store_true", help="only write the page")
    arguments = parser.parse_args()
    variations = random_variations()
    known: dict[int, SearchResult] = {}
    if arguments.out.is_file() and not arguments.anew:
        known = {case.index: case for case in REPORTS.validate_json(arguments.out.read_bytes())}
    if not arguments.page:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        run(variations[: arguments.number], known, arguments.out)
    PAGE.write_text("\n".join(page(variations, known)) + "\n", encoding="utf-8")


def run(variations: tuple[Variation, ...], known: dict[int, SearchResult], out: Path) -> None:
    """Run all variations as drawn, then search near the refused ones; results are stored after each."""
    for index, case in enumerate(variations):
        if index not in known:
            keep(SearchResult(index, run_variation(case)), known, out)
    for index, case in enumerate(variations):
        if known[index].attempt.stage is not None and known[index].tried == 0:
            keep(search_alternatives(index, case, known[index].attempt), known, out)


def keep(case: SearchResult, known: dict[int, SearchResult], out: Path) -> None:
    """Into the file, and a line on stderr."""
    known[case.index] = case
    what = case.attempt
    searched = f", {case.tried} others tried: {case.instead}" if case.tried else ""
    sys.stderr.write(f"{case.index}: {what.stage or 'carried out'} {what.reason}{searched}\n")
    out.write_bytes(REPORTS.dump_json([known[index] for index in sorted(known)], indent=1))


def page(variations: tuple[Variation, ...], known: dict[int, SearchResult]) -> Iterable[str]:
    """The page from the stored results."""
    cases = [known[index] for index in sorted(known)]
    carried_out = [case for case in cases if case.attempt.stage is None]
    refused = [case for case in cases if case.attempt.stage is not None]
    yield INTRO.format(number=len(cases), all_number=NUMBER, stairs=STAIRS)
    yield (
        f"- **Carried out** (every check of the certificate passed, and the replay completed): {len(carried_out)} of "
        f"{len(cases)}."
    )
    errors_mm = sorted(1e3 * case.attempt.com_error_m for case in carried_out if case.attempt.com_error_m is not None)
    if errors_mm:
        middle_mm = errors_mm[len(errors_mm) // 2]
        yield f"- CoM error of their replays: {middle_mm:.1f} mm in the median, {errors_mm[-1]:.1f} mm at most."
    not_completed = sum(case.attempt.fell_despite_certificate for case in cases)
    yield f"- **Passed every check and did not complete the replay:** {not_completed}."
    stages = Counter(case.attempt.stage for case in refused)
    yield f"- Refused: {len(refused)}" + (
        f" ({', '.join(f'{s}: {n}' for s, n in stages.items())})." if refused else "."
    )
    searched = [case for case in refused if case.tried]
    if searched:
        yield (
            "- Searched at other paces, with soles and hand elsewhere on the same stairs and rail: "
            f"{len(searched)}.\n  Of these, {sum(case.failure_confirmed for case in searched)} have no other flight "
            "that is carried out."
        )
    yield ""
    if refused:
        yield "## What is refused\n"
        yield "| | stairs, m | pace | rail, m | refused by | search |"
        yield "| --- " * 6 + "|"
        yield from (_refused(variations[case.index], case) for case in refused)
        yield ""
    yield "## All of them\n"
    yield "| | height, depth, toe gap (m) | pace | rail: ahead, height, side (m) | result | replay: CoM, mm |"
    yield "| --- " * 6 + "|"
    for case in cases:
        v, what = variations[case.index], case.attempt
        com = "" if what.com_error_m is None else f"{1e3 * what.com_error_m:.1f}"
        com += ", not completed" if what.replayed is False else ""
        yield f"| {case.index} | {_stairs(v)} | {v.pace:.2f} | {_rail(v)} | {what.stage or 'carried out'} | {com} |"


def _refused(v: Variation, case: SearchResult) -> str:
    reason = f"{case.attempt.stage}: {case.attempt.reason}".replace("|", "/")
    return f"| {case.index} | {_stairs(v)} | {v.pace:.2f} | {_rail(v)} | {reason} | {_search(case)} |"


def _search(case: SearchResult) -> str:
    if not case.tried:
        return "not made"
    if case.instead is None:
        return f"confirmed by {case.tried} others"
    v = case.instead
    changes = [f"pace {v.pace:.2f}"]
    changes += [f"soles {1e3 * v.shift_m:+.0f} mm towards the edge"] if v.shift_m else []
    changes += (
        [f"soles {1e3 * v.half_width_m:.0f} mm from the middle"] if v.half_width_m != Variation.half_width_m else []
    )
    changes += [f"hand {1e3 * v.reach_m:+.0f} mm along the rail"] if v.reach_m else []
    return f"carried out with {', '.join(changes)} (number {case.tried})"


def _stairs(v: Variation) -> str:
    return f"{v.height_m:.3f}, {v.depth_m:.3f}, {v.toe_gap_m:.4f}"


def _rail(v: Variation) -> str:
    return "" if v.rail is None else f"{v.rail.ahead_m:.2f}, {v.rail.height_m:.2f}, {v.rail.y_m:.2f}"


if __name__ == "__main__":
    main()
