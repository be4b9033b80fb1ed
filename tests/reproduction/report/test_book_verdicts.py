"""The page of the reproduction: every row follows from its numbers, and every verdict has an interval or a reason."""

import re
from pathlib import Path

import numpy as np

from experiments.reproduction_page import COLUMNS
from stridelab.reproduction.claims import WORDS, above, at_least, at_most, below, within
from stridelab.reproduction.registry import ITEMS
from stridelab.reproduction.report.formatting import NO_INTERVAL
from stridelab.reproduction.runner import PEOPLE

BOOK = Path(__file__).parents[3] / "docs" / "reproduction.md"
UNDECIDED = {WORDS["undecided"], WORDS["aim_undecided"]}
UNITS = {"mm": 1e-3, "ms": 1e-3}


def printed_number(text: str) -> float:
    """A number of the page in the unit of its claim, to the three digits that are printed."""
    number, _, unit = text.partition(" ")
    return float(number) * UNITS.get(unit, 1.0)


def assert_follows(holds: str, ours: str, verdict: str, evidence: str) -> None:
    """The verdict is the one that follows from the printed number, range and interval, as far as three digits tell."""
    value, bounds = printed_number(ours), holds.rpartition(" (")[0]
    ends = [printed_number(end) for end in re.split(" to ", bounds.lstrip("≤≥<> "))]
    low, high = (ends[0], ends[-1]) if bounds[0] not in "≤≥<>" else (
        (-np.inf, ends[0]) if bounds[0] in "≤<" else (ends[0], np.inf)
    )  # fmt: skip
    slack = 6e-3 * max(abs(value), abs(ends[0]))
    if low + slack < value < high - slack:
        assert verdict.strip("*") in ("met", "better", "our aim: reached", *UNDECIDED), (holds, ours, verdict)
    if value < low - slack or value > high + slack:
        assert verdict.strip("*") not in ("met", "our aim: reached"), (holds, ours, verdict)
        assert verdict != "better" or bounds[0] == ">", (holds, ours, verdict)
    interval = re.search(r"; 95 % from (\S+(?: \S+)?) to ([^;|]+)", evidence)
    if verdict in UNDECIDED:
        assert interval is not None, (holds, ours)
        ours_low, ours_high = (printed_number(end.strip()) for end in interval.groups())
        assert ours_low < low < ours_high or ours_low < high < ours_high, (holds, evidence)


def test_a_verdict_that_the_interval_does_not_settle_is_undecided() -> None:
    holds = within(-1.0, 2.0, "thesis")
    assert holds.verdict(0.0, (-0.5, 1.0)) == "met"
    assert holds.verdict(0.0, (-1.5, 1.0)) == holds.verdict(3.0, (1.0, 4.0)) == "undecided"
    assert holds.verdict(0.5, (-2.0, 3.0)) == "undecided", "an interval around the range settles nothing"
    assert holds.verdict(3.0, (2.5, 4.0)) == holds.verdict(-3.0, (-4.0, -1.5)) == "not_met"
    assert at_most(1.0, "words", otherwise="thesis_in_error").verdict(2.0, (1.5, 3.0)) == "thesis_in_error"
    assert at_most(1.0, "words").verdict(0.5, (float("nan"), 0.7)) == "undecided"
    assert at_most(1.0, "words").verdict(float("nan")) == "not_met"


def test_a_claim_is_settled_by_its_bounds_and_what_is_better_is_beyond_another() -> None:
    fast = at_most(10.0, "thesis", better_than=5.0)
    assert [fast.verdict(value) for value in (11.0, 10.0, 5.0, 4.9)] == ["not_met", "met", "met", "beaten"]
    high = at_least(20.0, "thesis", better_than=30.0)
    assert [high.verdict(value) for value in (19.0, 20.0, 31.0)] == ["not_met", "met", "beaten"]
    assert (above(0.5, "words").verdict(0.5), below(0.5, "words").verdict(0.5)) == ("not_met", "not_met")
    assert within(7.0, 7.0, "thesis").verdict(7.0) == "met"


def test_the_book_misses_no_item() -> None:
    """Every item has a section in docs/reproduction.md with a verdict on every claim."""
    parts = BOOK.read_text(encoding="utf-8").split("\n## ")[1:]
    sections = {part.partition(":")[0]: part for part in parts}
    assert set(sections) == {*ITEMS, *PEOPLE}
    for name, part in sections.items():
        claims = part.partition(f"|{' --- |' * len(COLUMNS)}\n")[2].partition("\n\n")[0].splitlines()
        assert claims, name
        for row in claims:
            assert row.count(" | ") == 6, row
            _, place, thesis, holds, ours, verdict, evidence = row.removesuffix(" |").split(" | ")
            assert verdict.strip("*") in WORDS.values(), row
            assert thesis.startswith("aim ") == verdict.startswith("our aim") == (place == "ours"), row
            assert holds.endswith(("(thesis)", "(its words)", "(our aim)")), row
            assert_follows(holds, ours, verdict, evidence)
            assert re.fullmatch(
                r"(simulated|replayed|people|external)(, deterministic)?, n = [1-9]\d*(; .*)?", evidence
            ), row
        assert f"Computed again by `stridelab reproduce {name}" in part, name
        assert re.search(r"(Draws nothing|One random sample|random draws, seeds)", part), name


def test_every_verdict_of_the_book_has_an_interval_or_says_why_not() -> None:
    """An interval of the number or of a share of cases; nothing drawn; or a reason that a reader can check."""
    parts = {part.partition(":")[0]: part for part in BOOK.read_text(encoding="utf-8").split("\n## ")[1:]}
    row_of_evidence = re.compile(r"\| (?:simulated|replayed|people|external),.* \|$", re.MULTILINE)
    found = {name: row_of_evidence.findall(part) for name, part in parts.items()}
    assert sum(map(len, found.values())) > 300
    rows = [row for of in found.values() for row in of]
    reasons = [text for key, text in NO_INTERVAL.items() if key != "deterministic"]
    silent_rows = [
        row for row in rows
        if "95 % from " not in row and "deterministic, n = " not in row and not any(text in row for text in reasons)
    ]  # fmt: skip
    assert silent_rows == []
    assert sum("one case, no interval" in row for row in rows) <= 1, "many draws, people or steps have one"
