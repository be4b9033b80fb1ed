"""The pages of figures computed anew: where they start, and what their results say."""

import re
from collections import Counter
from collections.abc import Callable
from typing import get_args

import httpx
import pytest
from markupsafe import escape

from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.reproduction import ClaimResult, Outcome, ReproduceSummary, ReproductionItem, Verdict
from stridelab_web.book.contents import page_file
from stridelab_web.formatting import item_name, verdict_text
from stridelab_web.pages.reproduction import read_recorded_items, recorded_items
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


def claim(key: str, judged: Verdict, thesis: float | str = 0.25) -> ClaimResult:
    return ClaimResult(
        key=key, says=f"claim {key}", thesis=thesis, ours=0.0125, unit="m", verdict=judged, note="",
        evidence="people", n=11, aim=str(thesis).startswith("aim"), solver="ipopt",
    )  # fmt: skip


AIM = claim("c", "beaten", "aim ≤ 1 mm")


@pytest.fixture
def page(fake: FakeService, browse: Browse) -> str:
    job = fake.add_job("reproduce", "succeeded")
    summary = ReproduceSummary(
        item="fig-2.6", title="Spectra of <the> errors", verdict="not_met", thesis={"a": 0.25}, ours={"a": 0.0125},
        claims=[claim("a", "not_met"), claim("b", "beaten", "about the same"), AIM],
        seeds=50, sampling="50 random draws.", note="What it means.",
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
        "claim a", "0.25 m", "12.5 mm", "not confirmed here", "people, n = 11; solver ipopt",
    ]  # fmt: skip
    assert "about the same" in rows["b"]
    assert "better than the thesis" in rows["b"]
    assert "our aim: reached" in rows["c"]
    assert 'data-verdict="not_met"' in page
    assert "Figure 2.6: Spectra of &lt;the&gt; errors" in page
    assert "50 random draws." in page


def test_the_drawing_is_shown_as_a_picture_from_the_interface(page: str) -> None:
    assert re.search(r'<img class="figure" src="/api/v1/jobs/\w+/artifacts/fig-2.6.svg"', page)
    assert "<svg" not in page.partition("<main")[2], "a drawing is never part of the page itself"


def add(fake: FakeService, name: str, judged: Verdict, seeds: int = 1) -> str:
    """A finished job of an item with one claim."""
    job = fake.add_job("reproduce", "succeeded")
    summary = ReproduceSummary(
        item=name, title=f"Title of {name}", verdict=judged, thesis={"a": 0.25}, ours={"a": 0.0125},
        claims=[claim("a", judged)], seeds=seeds, sampling=f"{seeds} random draws.", note="What it means.",
    )  # fmt: skip
    drawing = Artifact(name=f"{name}.svg", media_type="image/svg+xml", bytes=10)
    fake.results[job.id] = JobResult(
        kind="reproduce", input={"item": name}, versions={}, references=[],
        summary=summary.model_dump(mode="json"), artifacts=[drawing],
    )  # fmt: skip
    return job.id


def shown(page: str) -> dict[str, str]:
    """The part of the page of every item that has a result of this service, by its name."""
    parts = dict(re.findall(r'<article class="card item" id="([^"]+)"(.*?)</article>', page, re.DOTALL))
    return {name: part for name, part in parts.items() if "data-recorded" not in part}


def test_every_item_of_the_interface_can_be_started(fake: FakeService, browse: Browse) -> None:
    job = fake.add_job("reproduce", "running")
    other = fake.add_job(state="running")
    page = browse("/reproduction").text
    assert re.findall(r'<option value="([^"]+)"', page) == list(get_args(ReproductionItem))
    assert f"/jobs/{job.id}" in page
    assert f"/jobs/{other.id}" not in page


def test_what_has_no_result_has_a_button(fake: FakeService, browse: Browse) -> None:
    add(fake, "fig-2.6", "met")
    page = browse("/reproduction").text
    without = [name for name in get_args(ReproductionItem) if name != "fig-2.6"]
    assert re.findall(r'data-compute="([^"]+)"', page) == without
    assert re.search(rf'data-missing="{" ".join(without)}">Compute all missing items \({len(without)}\)', page)
    assert f"1 of {len(without) + 1} items are computed" in page
    for name in without:
        add(fake, name, "met")
    full = browse("/reproduction").text
    assert "data-missing" not in full
    assert "data-compute" not in full
    assert list(shown(full)) == list(get_args(ReproductionItem))


def test_an_item_is_shown_by_its_newest_result_with_claims_and_drawing(fake: FakeService, browse: Browse) -> None:
    old = add(fake, "fig-2.6", "not_met")
    new = add(fake, "fig-2.6", "met", seeds=7)
    add(fake, "numbers-3", "thesis_in_error")
    fake.add_job("reproduce", "failed")
    page = browse("/reproduction").text
    parts = shown(page)
    assert set(parts) == {"fig-2.6", "numbers-3"}
    assert 'data-verdict="met"' in parts["fig-2.6"]
    assert f'src="/api/v1/jobs/{new}/artifacts/fig-2.6.svg"' in parts["fig-2.6"]
    assert old not in page
    assert "7 random draws." in parts["fig-2.6"]
    assert "12.5 mm" in parts["fig-2.6"]
    assert "Figure 2.6: Title of fig-2.6" in parts["fig-2.6"]
    counts = re.search(r"<p data-counts>(.*?)</p>", page, re.DOTALL)
    assert counts is not None
    total = Counter(outcome for name, one in recorded_items().items() if name not in parts for outcome in one.outcomes)
    total.update(["thesis_in_error", "met"])
    marks = re.findall(r'<span class="mark [^>]*>(.*?)</span>', counts[1])
    assert marks == [f"{total[code]} {verdict_text(code)}" for code in get_args(Outcome) if total[code]]
    assert f"{total.total()} claims about {len(get_args(ReproductionItem))} figures" in page
    summary = parts["numbers-3"].partition('<span class="counts">')[2].partition("<img")[0]
    assert re.findall(r'<span class="mark [^>]*>(.*?)</span>', summary) == ["1 cannot hold as printed"]


def test_nothing_is_requested_twice_while_jobs_are_under_way(fake: FakeService, browse: Browse) -> None:
    assert not re.search(r"data-missing=[^>]* disabled>", browse("/reproduction").text)
    fake.add_job("reproduce", "queued")
    page = browse("/reproduction").text
    assert re.search(r"data-missing=[^>]* disabled>", page)
    assert "when the jobs above are finished" in page


def test_items_and_verdicts_have_names() -> None:
    assert item_name("fig-2.6") == "Figure 2.6"
    assert item_name("table-4.1") == "Table 4.1"
    names = [item_name(code) for code in get_args(ReproductionItem)]
    assert len(set(names)) == len(names)
    assert not any("-" in name or name != name.strip() for name in names)
    named = [verdict_text(code) for code in get_args(Outcome)]
    assert len(set(named)) == len(named)
    assert not any("_" in name for name in named)


def test_a_result_of_an_older_version_is_still_shown(fake: FakeService, browse: Browse) -> None:
    """Claims without evidence: everything was simulated, and an aim was known by its words."""
    job = fake.results[add(fake, "fig-2.6", "met", seeds=7)]
    for key in ("evidence", "n", "aim", "solver"):
        del job.summary["claims"][0][key]
    job.summary["claims"].append(job.summary["claims"][0] | {"key": "b", "thesis": "aim ≤ 2 mm", "verdict": "not_met"})
    page = browse("/reproduction").text
    assert "simulated, n = 7" in page
    assert "our aim: missed" in page


def test_the_form_names_the_items_that_draw(fake: FakeService, browse: Browse) -> None:
    page = browse("/reproduction").text
    draws, samples = re.search(r'data-draws="([^"]*)" data-samples="([^"]*)"', page).groups()  # type: ignore[union-attr]
    assert "fig-2.7" in draws.split()
    assert "fig-4.5" in samples.split()
    assert not {"fig-2.5", "table-4.1"} & {*draws.split(), *samples.split()}


def test_items_that_are_not_computed_show_what_the_book_has_recorded(fake: FakeService, browse: Browse) -> None:
    page = browse("/reproduction").text
    for name in get_args(ReproductionItem):
        part = page.partition(f'id="{name}"')[2].partition("</article>")[0]
        assert "Recorded in the" in part, name
        assert f'data-compute="{name}"' in part
    assert f"0 of {len(get_args(ReproductionItem))} items are computed here" in page


def test_items_without_a_drawing_show_their_claims_as_pictures(browse: Browse) -> None:
    page = browse("/reproduction").text
    for name, one in recorded_items().items():
        part = page.partition(f'id="{name}"')[2].partition("</article>")[0]
        pictures = part.partition('<ul class="pictures">')[2].partition("</ul>")[0]
        drawn = [bar for bar in one.bars if bar is not None]
        assert len(drawn) == len(one.bars), name
        assert pictures.count("<svg") == pictures.count("holds if") // 3 == min(len(drawn), 4), name
        failed = [row[0] for row, code in zip(one.rows, one.outcomes, strict=True) if code == "not_met"]
        assert not failed or str(escape(failed[0])) in pictures, "what does not hold comes first"


EVIDENCE = re.compile(r"\| (simulated|people|replayed|external)(, deterministic)?, n = ")


def test_every_claim_of_the_book_is_read() -> None:
    path = page_file("reproduction")
    assert path is not None
    sections = path.read_text(encoding="utf-8").split("\n## ")[1:]
    items = recorded_items()
    assert list(items) == list(get_args(ReproductionItem))
    for section in sections:
        name = section.partition(":")[0]
        lines = [line for line in section.splitlines() if EVIDENCE.search(line)]
        if name in items:
            assert len(items[name].rows) == len(lines) > 0, name
            for row, line in zip(items[name].rows, lines, strict=True):
                assert row[0] in line
                assert row[2] in line


def test_a_damaged_section_of_the_book_is_left_out() -> None:
    row = "| it holds | figure 2.2 | 1 | 0.5 to 1.5 (thesis) | 0.9 | met | simulated, n = 1 |"
    columns = ("claim", "place", "thesis", "holds if", "ours", "", "evidence")
    table = f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}"
    page = "# R\n\n## fig-2.2: One\n\nA *note*.\n\nComputed again by `it`.\n\n"
    page += f"{table}\n{row}\n{row.replace('met', 'perhaps')}\n"
    page += "\n## fig-2.5: Two\n\n**Not computed**: why\n\n## other: Three\n\nNote\n"
    items = read_recorded_items(page)
    assert list(items) == ["fig-2.2"]
    assert (items["fig-2.2"].title, items["fig-2.2"].note, len(items["fig-2.2"].rows)) == ("One", "A note.", 1)
