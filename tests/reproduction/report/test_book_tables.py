"""Tables of the theory pages that repeat numbers of the reproduction, and what the page says of its own run."""

import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

import make_reproduction
from experiments.reproduction_blocks import (
    BLOCKS,
    claims_table,
    coverage_block,
    estimators_block,
    height_block,
    read_claim,
    read_claims,
    three_axes_block,
)
from experiments.reproduction_page import insert_block
from make_reproduction import RunCost, measure_processor_s

DOCS = Path(__file__).parents[3] / "docs"
BOOK = DOCS / "reproduction.md"
PAGE = """# Head

## fig-1: Title

| claim | place | thesis | holds if | ours |  | evidence |
| --- | --- | --- | --- | --- | --- | --- |
| one is small | 1.1 | 1 | ≤ 1 (thesis) | 0.5 | met | people, n = 9; 95 % from 0.4 mm to 0.6 mm |
| two is small | 1.1 | 1 | ≤ 1 (thesis) | 1.5 | **not met** | simulated, deterministic, n = 1 |

- two is small: Because.

## fig-2: Title

No claims.
"""


@pytest.mark.parametrize(("name", "table"), BLOCKS)
def test_tables_of_other_pages_are_those_of_the_book(name: str, table: str) -> None:
    """One source: a number that is renewed in the book is renewed on the page, or this fails."""
    text = (DOCS / name).read_text(encoding="utf-8")
    assert insert_block(text, table, BLOCKS[name, table](BOOK.read_text(encoding="utf-8"))) == text


def test_every_table_between_comments_is_written_from_the_book() -> None:
    """None is left that no function writes."""
    marked = {
        (str(path.relative_to(DOCS)), name)
        for path in (DOCS / "theory").rglob("*.md")
        for name in re.findall(r"^<!-- (\S+) of reproduction\.md -->$", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert marked == set(BLOCKS)


def test_another_number_in_the_book_is_another_table() -> None:
    """With the numbers of all cells changed, no table stays as it was."""
    book = BOOK.read_text(encoding="utf-8")
    other = re.sub(r"(?<=\| )(-?\d+\.\d+)(?= (?:m?[sm] )?\|)", lambda number: f"{2 * float(number[1]) + 1:g}", book)
    assert [key for key, block_of in BLOCKS.items() if block_of(book) == block_of(other)] == []


def test_a_table_is_copied_cell_by_cell() -> None:
    cells = "0.1 | 0.2 | 0.3 | 1 | 2 | 3 | 4 | 5 | 6"
    kinds_of = ("thesis", "white", "table-40", "plate-bias", "mask", "first-order")
    rows = "".join(f"| {gait} | {kind} | {cells} |\n" for gait in ("robot", "human") for kind in kinds_of)
    page = f"# Head\n\n## coverage: Title\n\n| claim | x |\n| --- | --- |\n| a | b |\n\n| gait | s |\n| --- |\n{rows}"
    assert "| white noise | 1 / 2, 1 / 2 | 4 / 5, 4 / 5 | 0.1 / 0.2, 0.1 / 0.2 |" in coverage_block(page)
    with pytest.raises(KeyError):
        height_block(page)
    text = "before <!-- t of reproduction.md -->old<!-- end of t --> after"
    assert insert_block(text, "t", "new") == "before <!-- t of reproduction.md -->\n\nnew\n\n<!-- end of t --> after"
    with pytest.raises(KeyError):
        insert_block("without comments", "t", "new")


def test_a_claim_is_copied_with_its_verdict_and_evidence() -> None:
    one, two = read_claims(PAGE, "fig-1")
    assert (one.ours, one.interval, one.remark) == ("0.5", "0.4 mm to 0.6 mm", "")
    assert (two.verdict, two.interval, two.remark) == ("**not met**", "", "Because.")
    text = claims_table(PAGE, [("fig-1", "two")], remarks=True)
    assert text.splitlines()[2:] == [
        "| two is small | `fig-1` | 1 | 1.5 | **not met** | simulated, deterministic, n = 1 |",
        "",
        "- two is small: Because.",
    ]


@pytest.mark.parametrize(("item", "words"), [("fig-1", "is small"), ("fig-1", "three"), ("fig-2", "one"), ("x", "one")])
def test_a_claim_that_is_not_the_only_one_or_absent_is_refused(item: str, words: str) -> None:
    with pytest.raises(KeyError):
        read_claim(PAGE, item, words)


def test_errors_and_lags_stand_in_the_row_of_their_estimator() -> None:
    """By hand: the size of 3 / 4 / 12 is 13, of 0 / 0 / 6.5 it is 6.5."""
    names = ("geometry", "kalman-thesis", "kalman", "rts", "complementary-thesis", "complementary", "smoother")
    sizes = dict.fromkeys(names, "3 | 4 | 12 | 5 | 9") | {"complementary-thesis": "0 | 0 | 6.5 | 2.5 | 9"}
    errors = "".join(f"| {gait} | thesis | {name} | {sizes[name]} |\n" for gait in ("robot", "human") for name in names)
    lags = "".join(f"| {gait} | {name} | 1 | {gait[0]}{name} | 3 |\n" for gait in ("robot", "human") for name in names)
    page = f"# H\n\n## errors: T\n\n| gait | n |\n| - |\n{errors}\n## lag: T\n\n| gait | estimator | n |\n| - |\n{lags}"
    assert "| Kalman, thesis | 3 / 4 / 12 | 5 | rkalman-thesis | 3 / 4 / 12 | 5 | hkalman-thesis |" in estimators_block(
        page
    )
    assert three_axes_block(page).splitlines()[2:] == [
        "| Kalman, thesis | 3 / 4 / 12 | 5 | 13.0 |",
        "| complementary, thesis | 0 / 0 / 6.5 | 2.5 | 6.5 |",
        "| second over first |  | 0.50 | 0.50 |",
    ]


def test_the_page_says_what_the_run_computed_and_how_long_it_took() -> None:
    whole = RunCost(items=45, computed=45, processes=2, elapsed_s=696.4, processor_s=1305.0)
    part = RunCost(items=45, computed=3, processes=2, elapsed_s=65.0, processor_s=None)
    assert whole.sentence() == (
        "The run computed all 45 items in 11:36 minutes in up to 2 processes at a time, "
        "and 21:45 minutes of processor time."
    )
    assert part.sentence() == (
        "The run computed 3 of 45 items in 1:05 minutes in up to 2 processes at a time; "
        "the others had been computed before, by the same code."
    )
    assert whole.sentence() in make_reproduction.page_head([], 50, None, whole)


def test_processor_time_of_children_that_ended_and_of_children_that_run_is_counted() -> None:
    work = "import time\nwhile time.process_time() < 0.4: pass\n"
    before_s = measure_processor_s()
    subprocess.run([sys.executable, "-c", work], check=True)
    with subprocess.Popen([sys.executable, "-c", f"{work}print(flush=True)\ninput()"], stdin=-1, stdout=-1) as child:
        assert child.stdout is not None
        child.stdout.readline()
        spent_s = measure_processor_s() - before_s
        child.kill()
    assert spent_s >= 0.75


def test_what_comes_from_the_cache_is_not_counted_as_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(make_reproduction, "KEPT", tmp_path)
    wanted = make_reproduction.recipes_of(["fig-2.5"], 1, None)
    start = time.process_time()
    sections, first = make_reproduction.compute_all(wanted)
    used_s = time.process_time() - start
    _, again = make_reproduction.compute_all(wanted)
    assert [section.name for section in sections] == ["fig-2.5"]
    assert (first.items, first.computed, again.computed) == (1, 1, 0)
    assert first.processor_s is not None
    assert 0.0 < first.processor_s <= used_s + 0.1
    assert "fig-2.5: " in capsys.readouterr().err
