"""The page of reproduced figures and tables: every item with its newest result.

An item that this service has not computed shows the result that the book has recorded (``docs/reproduction.md``).
"""

import asyncio
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, get_args

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import FINAL_STATES, Artifact, Job, JobResult
from stridelab.schemas.reproduction import (
    ITEMS_WITH_DRAWS,
    ITEMS_WITH_SAMPLE,
    ClaimResult,
    Outcome,
    ReproduceSummary,
    ReproductionItem,
)
from stridelab_web.api_client import JobFiles, client_of
from stridelab_web.book.contents import page_file
from stridelab_web.charts.claim_bars import ClaimBar, draw_claim, read_claim
from stridelab_web.formatting import with_unit
from stridelab_web.pages.render import render_page

KIND: Final = "reproduce"
ITEMS: Final[tuple[str, ...]] = get_args(ReproductionItem)
PAGE_SIZE: Final = 50
"""Number of jobs that are listed, and of results that are read, at a time."""
MAX_SEARCHED_JOBS: Final = 100
"""Maximum number of finished jobs that are searched; items not among them count as missing."""
MAX_PICTURES: Final = 4
"""Number of claims that the card of an item without a drawing shows as pictures; all are in its table."""
LEGEND: Final = draw_claim(1.4, (None, 2.0), (1.0, 1.7), ("example", "holds if at most 2"))
SVG: Final = "image/svg+xml"
_CLAIM, _THESIS, _HOLDS, _OURS, _VERDICT, _EVIDENCE, _COLUMNS = 0, 2, 3, 4, 5, 6, 7
"""Columns of a table of claims, and their number."""
_OUTCOMES: Final[Mapping[str, Outcome]] = {
    "met": "met",
    "better": "beaten",
    "not met": "not_met",
    "thesis in error": "thesis_in_error",
    "our aim: reached": "aim_reached",
    "our aim: missed": "aim_missed",
    "our aim: undecided": "aim_undecided",
    "undecided": "undecided",
}
"""Outcomes by their words in the book."""


@dataclass(frozen=True)
class ShownItem:
    """The newest result of one item; ``drawing`` is the name of its SVG."""

    job: Job
    reproduction: ReproduceSummary
    drawing: str | None

    @property
    def outcome_counts(self) -> Mapping[Outcome, int]:
        """How many of its claims have each outcome."""
        return count_outcomes([self.reproduction])


@dataclass(frozen=True)
class RecordedItem:
    """The recorded result of one item.

    ``rows`` are claim, the thesis' value, ours, verdict and evidence, as texts; ``bars`` are their pictures.
    """

    title: str
    note: str
    rows: tuple[tuple[str, ...], ...]
    outcomes: tuple[Outcome, ...]
    bars: tuple[ClaimBar | None, ...]

    @property
    def outcome_counts(self) -> Mapping[Outcome, int]:
        """How many of its claims have each outcome."""
        return Counter(self.outcomes)


@cache
def recorded_items() -> Mapping[str, RecordedItem]:
    """Results in the book by item; empty without that page."""
    path = page_file("reproduction")
    return {} if path is None else read_recorded_items(path.read_text(encoding="utf-8"))


def read_recorded_items(page: str) -> dict[str, RecordedItem]:
    """Items of the page that ``scripts/make_reproduction.py`` writes; the first table of a section has the claims."""
    items: dict[str, RecordedItem] = {}
    for section in page.split("\n## ")[1:]:
        heading, _, body = section.partition("\n")
        name, _, title = heading.partition(": ")
        paragraphs = body.strip().split("\n\n")
        table = next((text for text in paragraphs if text.startswith("| claim |")), "")
        cells = [[cell.strip().strip("*") for cell in line.strip("|").split(" | ")] for line in table.splitlines()[2:]]
        judged = [
            (
                tuple(row[k] for k in (_CLAIM, _THESIS, _OURS, _VERDICT, _EVIDENCE)),
                _OUTCOMES[row[_VERDICT]],
                read_claim(row[_HOLDS], row[_OURS], row[_EVIDENCE]),
            )
            for row in cells
            if len(row) == _COLUMNS and row[_VERDICT] in _OUTCOMES
        ]
        if name in ITEMS and judged:
            shown, outcomes, bars = zip(*judged, strict=True)
            items[name] = RecordedItem(title, re.sub(r"[*`]", "", paragraphs[0]), shown, outcomes, bars)
    return items


async def reproduction_page(request: Request) -> Response:
    """``GET /reproduction``."""
    client = client_of(request)
    recorded = recorded_items()
    recent, results = await asyncio.gather(client.jobs(PAGE_SIZE, kind=KIND), _newest_results(client))
    return render_page(
        request,
        "pages/reproduction.html",
        section="Reproduction",
        items=ITEMS,
        results=results,
        missing=[name for name in ITEMS if name not in results],
        recorded=recorded,
        counts=sum((Counter(of.outcome_counts) for of in {**recorded, **results}.values()), Counter[Outcome]()),
        outcomes=get_args(Outcome),
        bar_of=claim_bar,
        legend=LEGEND,
        order_of=order_of_pictures,
        drawn=sorted(ITEMS_WITH_DRAWS),
        sampled=sorted(ITEMS_WITH_SAMPLE),
        open_jobs=[job for job in recent.items if job.state not in FINAL_STATES],
    )


async def _newest_results(client: AsyncClient) -> dict[str, ShownItem]:
    """The newest result of every computed item, in the order of the items."""
    newest: dict[str, ShownItem] = {}
    cursor, seen = None, 0
    while seen < MAX_SEARCHED_JOBS and len(newest) < len(ITEMS):
        listed = await client.jobs(PAGE_SIZE, cursor, state="succeeded", kind=KIND)
        results = await asyncio.gather(*(client.result(job.id) for job in listed.items))
        for job, result in zip(listed.items, results, strict=True):
            summary = reproduction_of(result)
            if summary.item in ITEMS:
                newest.setdefault(summary.item, ShownItem(job, summary, _svg_name(result.artifacts)))
        seen, cursor = seen + len(listed.items), listed.next
        if cursor is None:
            break
    return {name: newest[name] for name in ITEMS if name in newest}


def claim_bar(claim: ClaimResult) -> ClaimBar | None:
    """The picture of a computed claim; None if no range is stated."""
    caption = f"holds if {claim.holds}"
    if claim.interval is not None:
        low, high = (with_unit(value, claim.unit) for value in claim.interval)
        caption = f"95 % from {low} to {high}; {caption}"
    texts = (with_unit(claim.ours, claim.unit), caption)
    return draw_claim(claim.ours, (claim.holds_from, claim.holds_to), claim.interval, texts)


def order_of_pictures(outcomes: Sequence[Outcome]) -> list[int]:
    """Indices of the claims that a card shows: those that do not hold first, then undecided ones, then the others."""
    ranks = {"not_met": 0, "thesis_in_error": 0, "aim_missed": 0, "undecided": 1, "aim_undecided": 1}
    return sorted(range(len(outcomes)), key=lambda k: ranks.get(outcomes[k], 2))[:MAX_PICTURES]


def count_outcomes(summaries: Iterable[ReproduceSummary]) -> Mapping[Outcome, int]:
    """How many claims have each verdict on the thesis, and how many of our aims are reached and missed."""
    return Counter(claim.outcome for summary in summaries for claim in summary.claims)


def _svg_name(artifacts: Iterable[Artifact]) -> str | None:
    return next((artifact.name for artifact in artifacts if artifact.media_type == SVG), None)


def reproduction_of(result: JobResult) -> ReproduceSummary:
    """The summary of a reproduction."""
    return ReproduceSummary.model_validate(result.summary)


async def stored_drawings(files: JobFiles, result: JobResult) -> list[str]:
    """Names of the drawings of a reproduction whose files are still stored."""
    drawings = [item.name for item in result.artifacts if item.media_type == "image/svg+xml"]
    return [name for name in drawings if await files.read_file(name) is not None]
