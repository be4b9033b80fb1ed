"""The card on the pages of a result that says whether the sensors agree: before any number, red where they do not."""

import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from stridelab.schemas.base import Remark
from stridelab.schemas.quality import SHARES, Quality, QualityCheck
from stridelab_web.pages.results.quality import NAMES, shown_quality
from support.fakes import results
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
KINDS = ("estimate-com", results.COMPARISON_KIND, "fit-cycloid", results.POPULATION_KIND, results.MEASURES_KIND)


def check(name: str, value: float, limit: float, contradicted_above: float, unit: str = "1") -> QualityCheck:
    return QualityCheck(
        name=name, value=value, unit=unit, limit=limit, contradicted_above=contradicted_above, passed=value <= limit,
        message=f"Sentence of {name}.",
    )  # fmt: skip


def quality(bias_m: float) -> Quality:
    verdict: Any = "good" if bias_m <= 0.022 else "contradicted" if bias_m > 0.05 else "doubtful"
    checks = [check("horizontal_bias", bias_m, 0.022, 0.05, "m"), check("force_residual", 0.012, 0.03, 0.15)]
    return Quality(verdict=verdict, checks=checks, not_checked={"mass_from_standing": "no static trial"})


def page_of(fake: FakeService, browse: Browse, kind: str, found: Quality | None) -> str:
    job = fake.add_comparison() if kind == results.COMPARISON_KIND else fake.add_job(kind, "succeeded")
    plain = fake.result(job.id)
    warnings = plain.summary["warnings"]
    if found is not None and found.verdict != "good":
        warnings = [Remark(code=found.verdict, message="Sentence of the verdict.").model_dump(), *warnings]
    shown = None if found is None else found.model_dump(mode="json")
    summary = plain.summary | {"quality": shown, "warnings": warnings}
    fake.results[job.id] = plain.model_copy(update={"summary": summary})
    answer = browse(f"/{'population' if kind == results.POPULATION_KIND else 'jobs'}/{job.id}")
    assert answer.status_code == 200
    return answer.text


@pytest.mark.parametrize("kind", KINDS)
def test_a_contradiction_stands_before_any_number(fake: FakeService, browse: Browse, kind: str) -> None:
    page = page_of(fake, browse, kind, quality(0.3))
    alarm = page.index('class="card quality contradicted"')
    assert 'aria-labelledby="quality-h" role="alert"' in page
    assert "The sensors contradict each other: do not use these numbers" in page
    numbers = [page.find(mark) for mark in ('class="number', "data-fact", "data-sentence")]
    assert alarm < min(place for place in numbers if place >= 0)
    assert page.index("Sentence of horizontal_bias.") < page.index("<details>", alarm)
    assert "Sentence of the verdict." not in page


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_result_says_so_without_alarm(fake: FakeService, browse: Browse, kind: str) -> None:
    page = page_of(fake, browse, kind, quality(0.004))
    assert 'data-verdict="good"' in page
    assert "The sensors agree" in page
    assert 'aria-labelledby="quality-h"' in page
    assert 'aria-labelledby="quality-h" role="alert"' not in page
    assert "2 checks, 1 not possible" in page


def test_a_doubtful_result_names_what_does_not_pass_with_its_limit(fake: FakeService, browse: Browse) -> None:
    page = page_of(fake, browse, "estimate-com", quality(0.03))
    assert 'data-verdict="doubtful"' in page
    rows = dict(re.findall(r'<tr data-check="([^"]+)">(.*?)</tr>', page))
    assert re.findall(r'class="number">([^<]*)<', rows["horizontal_bias"]) == ["30 mm", "22 mm"]
    assert re.findall(r'class="number">([^<]*)<', rows["force_residual"]) == ["1.2 %", "3.0 %"]
    assert 'class="mark bad">no' in rows["horizontal_bias"]
    assert 'class="mark">yes' in rows["force_residual"]
    assert 'data-fact="quality' not in page


def test_a_result_of_a_version_without_checks_has_no_card(fake: FakeService, browse: Browse) -> None:
    assert 'class="card quality' not in page_of(fake, browse, "estimate-com", None)
    assert shown_quality({"com": 1}) is None


def test_every_check_of_the_program_has_a_name_for_people() -> None:
    from stridelab.estimation.quality.limits import LIMITS

    assert set(NAMES) == set(LIMITS)
    assert {name for name in SHARES if LIMITS[name].unit != "1"} == set()
