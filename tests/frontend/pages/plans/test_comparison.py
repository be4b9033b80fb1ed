"""Plan against plan: numbers side by side, both curves over one axis, and a sentence where that cannot be."""

import re
from collections.abc import Callable
from typing import Any

import httpx
import numpy as np
import pytest

from stridelab.schemas.scenarios import Scenario
from stridelab_web.pages.plans.comparison import PairRow, PlanFacts, max_com_distance, pair_remarks, pair_rows
from stridelab_web.pages.plans.plots import pair_curves
from support.fakes import robots
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


def facts(*, whole_body: bool = True, **changes: Any) -> PlanFacts:
    return PlanFacts({}, robots.plan_summary(whole_body=whole_body).model_copy(update=changes))


def rows(first: PlanFacts, second: PlanFacts) -> dict[str, PairRow]:
    return {row.key: row for row in pair_rows(first, second)}


def brief() -> Scenario:
    """The scenario without its last phase."""
    given = robots.scenario()
    return given.model_copy(update={"phases": given.phases[:-1]})


def test_equal_plans_differ_by_nothing() -> None:
    result = pair_rows(facts(), facts())
    assert {row.difference for row in result} == {"0", ""}
    assert {row.note for row in result} == {""}
    assert pair_remarks(facts(), facts()) == []


def test_rounding_is_no_difference_and_unknown_densities_do_not_differ() -> None:
    mine, theirs = (facts(solve_time_s=value, measure=None) for value in (0.99, 0.99 - 2e-15))
    assert rows(mine, theirs)["solve_time_s"].difference == "0"
    assert pair_remarks(mine, facts()) == []


def test_differences_are_the_first_less_the_second() -> None:
    compared = rows(facts(iterations=30, objective=-14.0), facts(solve_time_s=0.5))
    assert (compared["iterations"].first, compared["iterations"].second, compared["iterations"].difference) == (
        "30",
        "18",
        "+12",
    )
    assert compared["objective"].difference == "+0.4670 s"
    assert compared["solve_time_s"].difference == "+50 ms"
    assert compared["terrain_distance_min"].difference == "0"
    assert compared["replay.com_error_max_m"].first == "0.25 m"


def test_what_only_one_plan_has_is_not_compared() -> None:
    compared = rows(facts(), facts(whole_body=False))
    assert (compared["certificate"].first, compared["certificate"].second) == ("not passed", "–")
    assert "terrain_distance_min" not in compared
    assert "certificate" not in rows(facts(whole_body=False), facts(whole_body=False))


@pytest.mark.parametrize(
    ("other", "kept", "not_compared", "said"),
    [
        (facts(duration_s=6.0), set(), {"objective", "com_acceleration", "point_force"}, "5.00 s and 6.00 s"),
        (facts(robot="rare"), set(), {"objective", "com_acceleration"}, "The robots differ"),
        (
            facts(measure="uniform"), {"com_acceleration", "surface_force"},
            {"objective", "log_density_left_foot"}, "The densities differ",
        ),
        (
            facts(formulation="wrench"), {"objective", "log_density_left_foot"},
            {"point_force", "surface_force"}, "The controls differ (forces and wrench)",
        ),
        (facts(formulation="circular-cones"), {"objective", "point_force"}, set(), "(forces and circular cones)"),
        (
            facts(weights=robots.WEIGHTS.model_copy(update={"momentum_rate": 1.0})), {"com_acceleration"},
            {"objective", "momentum_rate"}, "",
        ),
    ],
    ids=["time", "robot", "densities", "control", "cones", "weights"],
)  # fmt: skip
def test_figures_that_cannot_be_compared_have_no_difference(
    other: PlanFacts, kept: set[str], not_compared: set[str], said: str
) -> None:
    compared = rows(facts(), other)
    assert {key for key in not_compared if compared[key].note and compared[key].difference == "–"} == not_compared
    assert {key for key in kept if not compared[key].note} == kept
    assert said in " ".join(pair_remarks(facts(), other))


def test_the_distance_of_two_paths_is_that_between_their_nodes() -> None:
    first = robots.centroidal(robots.scenario())
    second = {name: values[::7] for name, values in first.items()} | {"com_y_m": first["com_y_m"][::7] + 0.03}
    distance_m, _ = max_com_distance(first, second)
    assert 0.03 <= distance_m < 0.0302  # coarser nodes follow the constant acceleration of each half


def test_both_curves_are_drawn_at_the_nodes_of_both_while_they_last() -> None:
    given = robots.scenario()
    first, short = robots.centroidal(given), robots.centroidal(brief())
    second = short | {"f_left_foot_0_z_n": short["f_left_foot_0_z_n"] + np.arange(len(short["time_s"]))}
    drawn = pair_curves(first, second, given)
    columns = drawn["columns"]
    assert np.allclose(columns["com_x_m"], first["com_x_m"], atol=1e-5)
    n = len(second["time_s"])
    assert columns["other_com_x_m"][n:] == [None] * (len(first["time_s"]) - n)
    assert np.allclose(columns["other_com_x_m"][:n], second["com_x_m"], atol=1e-5)
    assert columns["other_left_foot_fz_n"][3] == 403.0
    styles = {trace["style"] for row in drawn["rows"] for trace in row["traces"] if trace["key"].startswith("other_")}
    assert all(style.startswith("dashed") for style in styles)
    assert drawn["readings"][0]["more"] == ("other_com_x_m",)


def test_the_page_shows_both_and_offers_those_of_the_scenario_first(fake: FakeService, browse: Browse) -> None:
    elsewhere = fake.add_plan(given=robots.scenario())
    scenario = fake.add_scenario()
    job, other = (fake.add_plan(scenario_id=scenario.id) for _ in range(2))
    for each in (job, other):
        fake.change(each.id, scenario_id=scenario.id)
    page = browse(f"/plans/{job.id}?with={other.id}").text
    assert f'data-plots="/plans/{job.id}/plots.json?with={other.id}"' in page
    assert re.search(rf'<option value="{other.id}" selected[ >]', page)
    assert f'value="{job.id}"' not in page
    assert page.index(other.id) < page.index(elsewhere.id)
    assert 'data-figure="objective"' in page
    assert "CoM paths apart, at most</th><td" in page
    assert "other_com_x_m" in browse(f"/plans/{job.id}/plots.json?with={other.id}").json()["columns"]
    alone = browse(f"/plans/{job.id}").text
    assert 'data-plots="/plans/' + job.id + '/plots.json"' in alone
    assert "data-figure" not in alone


def test_another_plan_that_cannot_be_shown_is_named_and_this_one_stays(fake: FakeService, browse: Browse) -> None:
    job, running = fake.add_plan(), fake.add_job("plan-motion", "running")
    message = {
        job.id: "This is the same plan",
        "gone": "does not exist; it may have been deleted",
        running.id: "The other plan is running",
        fake.add_job("estimate-com", "succeeded").id: "The other job is not a plan",
        '"><b>': "does not exist; it may have been deleted",
    }
    for other, sentence in message.items():
        answer = browse(f"/plans/{job.id}?with={other}")
        assert answer.status_code == 200
        assert sentence in re.search(r"data-pair-refusal>([^<]*)<", answer.text).group(1)  # type: ignore[union-attr]
        assert 'data-plots="/plans/' + job.id + '/plots.json"' in answer.text
        assert "<b>" not in answer.text.replace("<body", "")
        assert browse(f"/plans/{job.id}/plots.json?with={other}").status_code in (404, 409)


def test_a_plan_alone_in_the_world_says_so(fake: FakeService, browse: Browse) -> None:
    assert "There is no other finished plan yet." in browse(f"/plans/{fake.add_plan().id}").text
