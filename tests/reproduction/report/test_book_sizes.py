"""Sizes of samples that tests make smaller are those that the book states."""

import re
from pathlib import Path

import pytest

from stridelab.reproduction.chapter3 import height_people
from stridelab.reproduction.chapter4 import fig_4_5, numbers, table_4_1

DOCS = Path(__file__).parents[3] / "docs"
WORDS = {3: "three"}


def section_of(item: str) -> str:
    """The part of the book on an item."""
    book = (DOCS / "reproduction.md").read_text(encoding="utf-8")
    return book.partition(f"\n## {item}: ")[2].partition("\n## ")[0]


@pytest.mark.parametrize(
    ("item", "words", "size"),
    [
        ("fig-4.5", r"(\d+) postures of the ground truth", fig_4_5.DRAWS),
        ("table-4.1", r"minimum of (\w+)", table_4_1.REPEATS),
        ("numbers-4", r"around 10 ns \|.*n = (\d+); time", numbers.REPEATS),
        ("numbers-4", r"for 25 s of motion .*n = (\d+); solver", numbers.REPEATS),
        ("height-people", r"(\d+) refits", height_people.DRAWS),
        ("height-people", r"(\d+) trials each", height_people.TRIALS),
    ],
)
def test_sizes_are_those_of_the_book(item: str, words: str, size: int) -> None:
    stated = re.search(words, section_of(item))
    assert stated is not None, words
    assert stated.group(1) in (str(size), WORDS.get(size))


def test_shares_of_probes_are_those_of_so_many() -> None:
    """Each share in the table is a number of probes over all of them, as far as its three digits tell."""
    row = r"^\| \d contacts \| \w+ \| [\d.]+ \| [\d.]+ \| ([\d.]+) \|"
    shares = re.findall(row, section_of("fig-4.5"), re.MULTILINE)
    assert len(shares) == 6
    for share in shares:
        rounding = 0.5 * 10.0 ** -len(share.partition(".")[2])
        probes = float(share) * fig_4_5.PROBES
        assert abs(probes - round(probes)) <= 1.01 * rounding * fig_4_5.PROBES, share
