"""The pages of figures computed anew: where they start, and what their results say."""

import re
from collections.abc import Callable
from typing import get_args

import httpx
import pytest

from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.reproduction import ClaimResult, ReproduceSummary, ReproductionItem, Verdict
from stridelab_web.words import item, verdict
from support.fake_service import FakeService

Browse = Callable[[str], httpx.Response]


def claim(key: str, judged: Verdict, thesis: float | str = 0.25) -> ClaimResult:
    return ClaimResult(key=key, says=f"claim {key}", thesis=thesis, ours=0.0125, unit="m", verdict=judged, note="")


@pytest.fixture
def page(fake: FakeService, browse: Browse) -> str:
    job = fake.add_job("reproduce", "succeeded")
    summary = ReproduceSummary(
        item="fig-2.6", title="Spectra of <the> errors", verdict="not_met", thesis={"a": 0.25}, ours={"a": 0.0125},
        claims=[claim("a", "not_met"), claim("b", "beaten", "about the same")], seeds=50, note="What it means.",
    )  # fmt: skip
    drawing = Artifact(name="fig-2.6.svg", media_type="image/svg+xml", bytes=10)
    fake.results[job.id] = JobResult(
        kind="reproduce", input={"item": "fig-2.6"}, versions={}, references=[],
        summary=summary.model_dump(mode="json"), artifacts=[drawing],
    )  # fmt: skip
    return browse(f"/jobs/{job.id}").text


def test_every_claim_stands_beside_our_number_with_its_verdict(page: str) -> None:
    rows = dict(re.findall(r'<tr data-claim="(\w)">(.*?)</tr>', page, re.DOTALL))
    assert re.findall(r"<td[^>]*>(?:<span[^>]*>)?([^<]+)", rows["a"]) == [
        "claim a", "0.25 m", "12.5 mm", "not reached here",
    ]  # fmt: skip
    assert "about the same" in rows["b"]
    assert "our aim, reached" in rows["b"]
    assert 'data-verdict="not_met"' in page
    assert "Figure 2.6: Spectra of &lt;the&gt; errors" in page
    assert "Repeated on 50 simulated walks." in page


def test_the_drawing_is_shown_as_a_picture_from_the_interface(page: str) -> None:
    assert re.search(r'<img class="figure" src="/api/v1/jobs/\w+/artifacts/fig-2.6.svg"', page)
    assert "<svg" not in page.partition("<main")[2], "a drawing is never part of the page itself"


def test_every_item_of_the_interface_can_be_started(fake: FakeService, browse: Browse) -> None:
    job = fake.add_job("reproduce", "running")
    other = fake.add_job(state="running")
    page = browse("/reproduction").text
    assert re.findall(r'<option value="([^"]+)"', page) == list(get_args(ReproductionItem))
    assert f"/jobs/{job.id}" in page
    assert f"/jobs/{other.id}" not in page


def test_what_was_computed_is_listed_by_its_name(page: str, browse: Browse) -> None:
    listed = browse("/reproduction").text
    assert "Figure 2.6: not reached here" in listed


def test_items_and_verdicts_have_names() -> None:
    assert item("fig-2.6") == "Figure 2.6"
    assert item("table-4.1") == "Table 4.1"
    names = [item(code) for code in get_args(ReproductionItem)]
    assert len(set(names)) == len(names)
    assert not any("-" in name or name != name.strip() for name in names)
    named = [verdict(code) for code in get_args(Verdict)]
    assert len(set(named)) == len(named)
    assert not any("_" in name for name in named)
