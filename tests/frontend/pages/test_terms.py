"""Every term on the pages of plans, results, robots and sweeps is explained, with a link into the book."""

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import httpx
import pytest
from pydantic import BaseModel

from stridelab import estimation
from stridelab.schemas.jobs import EstimateComSummary, JobResult, SimulateRecordingSummary
from stridelab.schemas.plans import PLAN_STAGES, PlanContactsSummary
from stridelab.schemas.robots import CommissionRobotSummary, LearnReachabilitySummary
from stridelab.schemas.sweeps import SweepField, SweepOutcome
from stridelab_web.pages.results.summary_facts import NAMES, facts_of
from stridelab_web.pages.terms import checks, plans, results, robots, sweeps
from stridelab_web.pages.terms.results import result_term
from stridelab_web.pages.terms.term import Term
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]
SUMMARIES = (
    EstimateComSummary,
    SimulateRecordingSummary,
    PlanContactsSummary,
    LearnReachabilitySummary,
    CommissionRobotSummary,
)
"""Summaries whose values are shown by name."""
TABLES: tuple[Mapping[str, Term], ...] = (
    plans.PLAN_TERMS,
    plans.REPLAY_TERMS,
    plans.STAGE_TERMS,
    plans.COST_TERMS,
    plans.COST_COLUMNS,
    robots.DENSITY_TERMS,
    robots.ROBOT_TERMS,
    results.ESTIMATE_TERMS,
    results.OTHER_TERMS,
    sweeps.FIELD_TERMS,
    sweeps.OUTCOME_TERMS,
    sweeps.EFFORT_TERMS,
)
_DT = re.compile(r"<dt>(.*?)</dt>", re.DOTALL)


def all_terms() -> Iterator[Term]:
    for table in TABLES:
        yield from table.values()
    for name in checks.CHECK_MEANINGS:
        term = checks.check_term(name)
        assert term is not None
        yield term


def example_of(annotation: Any) -> Any:
    """A value of the type ``annotation`` for the fields of a summary; None if it is none of those that are shown."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {name: example_of(field.annotation) for name, field in annotation.model_fields.items()}
    arguments = [one for one in get_args(annotation) if one is not type(None)]
    shape = str(annotation)
    if shape.startswith("dict["):
        return {"example": example_of(arguments[1])}
    if shape.startswith(("list[", "tuple[")):
        return [1.0] if float in arguments else []
    return example_of(arguments[0]) if arguments else 1.0


@pytest.mark.parametrize("summary", SUMMARIES)
def test_every_value_of_a_result_is_explained(summary: type[BaseModel]) -> None:
    given = {name: example_of(field.annotation) for name, field in summary.model_fields.items()}
    given |= {"observability": {}, "diagnostics": {}} if summary is EstimateComSummary else {}
    result = JobResult(kind="any", input={}, versions={}, references=[], summary=given, artifacts=[])
    facts = facts_of(result)
    assert facts
    assert [fact.key for fact in facts if fact.explained is None] == []


def diagnostics_in_code() -> set[str]:
    """Names of the diagnostics of all estimators: keys of dictionaries in ``diagnostics=`` and in their helper."""
    trees = [ast.parse(one.read_text(encoding="utf-8")) for one in Path(estimation.__path__[0]).rglob("*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    given: list[ast.AST] = [one.value for one in nodes if isinstance(one, ast.keyword) and one.arg == "diagnostics"]
    given += [one for one in nodes if isinstance(one, ast.FunctionDef) and one.name.endswith("_diagnostics")]
    dictionaries = [one for node in given for one in ast.walk(node) if isinstance(one, ast.Dict)]
    return {str(key.value) for one in dictionaries for key in one.keys if isinstance(key, ast.Constant)}


def test_every_diagnostic_of_an_estimator_is_explained() -> None:
    named = diagnostics_in_code()
    assert len(named) > 9
    assert [one for one in named if result_term(f"diagnostics.{one}") is None] == []


def test_every_named_value_is_explained() -> None:
    assert [key for key in NAMES if result_term(key) is None] == []


def test_outcomes_fields_and_stages_are_explained() -> None:
    assert set(get_args(SweepField)) == set(sweeps.FIELD_TERMS)
    assert set(get_args(SweepOutcome)) == set(sweeps.OUTCOME_TERMS)
    assert set(PLAN_STAGES) == set(plans.STAGE_TERMS)


def test_every_explanation_is_short_and_leads_into_the_book(browse: Browse) -> None:
    pages: dict[str, str] = {}
    for term in all_terms():
        assert 10 < len(term.meaning) < 90, term
        address, _, anchor = term.chapter.partition("#")
        page = pages.setdefault(address, browse(address).text)
        assert "<h1" in page, term
        assert not anchor or f'id="{anchor}"' in page, term


def test_a_plan_explains_all_its_values_and_costs(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/plans/{fake.add_plan(replay=True).id}").text
    listed = _DT.findall(page)
    assert len(listed) > 12
    assert [one for one in listed if "data-meaning" not in one] == []
    costs = page[page.index('id="costs-h"') :]
    headings = re.findall(r'<th scope="(?:row|col)"[^>]*>(.*?)</th>', costs[: costs.index("</table>")], re.DOTALL)
    terms = [one for one in headings if "visually-hidden" not in one and one != "Term"]
    assert len(terms) > 5
    assert [one for one in terms if "data-meaning" not in one] == []


def test_a_robot_explains_every_column_of_its_densities(browse: Browse) -> None:
    page = browse("/robots/talos").text
    table = page[page.index('aria-label="Densities by effector"') :]
    columns = re.findall(r'<th scope="col"[^>]*>([^<]+)', table[: table.index("</thead>")])
    explained = " ".join(_DT.findall(page[page.index("data-terms") :]))
    percentages = {"80 %", "95 %"}
    assert len(columns) == 10
    assert [one for one in columns if one not in percentages and one.split(" of ")[0] not in explained] == []
    summary = page[page.index('id="facts-h"') : page.index('id="effectors-h"')]
    assert [one for one in _DT.findall(summary) if "data-meaning" not in one] == []
