"""Pages of the robot wing say what the interface says."""

import json
import re
from collections.abc import Callable

import httpx
import numpy as np
import pytest

from stridelab.schemas.base import FaultItem, Problem, Remark
from stridelab.schemas.jobs import Progress
from stridelab.schemas.plans import PhaseDuration, PlanMotionSummary, ReplayOptions, StoppedMotion
from stridelab_web.pages.plans.cost_table import cost_rows
from stridelab_web.pages.plans.durations import chosen_durations
from stridelab_web.pages.terms.plans import STAGE_TERMS
from support.fakes import robots
from support.fakes.service import FakeService

Browse = Callable[[str], httpx.Response]


def texts(page: str) -> str:
    """What a reader sees, in one line."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page))


def test_home_plans_a_scenario_with_one_press(fake: FakeService, browse: Browse) -> None:
    scenario = fake.add_scenario(bundled=True)
    page = browse("/").text
    assert f'data-plan="{scenario.id}"' in page
    assert f'href="/scenarios/{scenario.id}"' in page
    assert "<polygon" in page


def test_list_of_scenarios_and_what_a_name_smuggles_in(fake: FakeService, browse: Browse) -> None:
    scenario = fake.add_scenario(given=robots.scenario(name="<b>stairs</b>"))
    page = browse("/scenarios").text
    assert "<b>stairs" not in page
    assert "&lt;b&gt;stairs" in page
    assert f'href="/view/?scenario={scenario.id}"' in page
    assert "boxes · " in page
    assert "9 phases" in texts(page)


def test_scenario_page_shows_pictures_check_and_plans(fake: FakeService, browse: Browse) -> None:
    scenario = fake.add_scenario()
    job = fake.add_job(
        "plan-motion", "running", scenario_id=scenario.id, progress=Progress(fraction=0.4, message="whole body")
    )
    other = fake.add_job("plan-motion", "succeeded", scenario_id="another")
    page = browse(f"/scenarios/{scenario.id}").text
    assert page.count('<svg class="drawing') == 2
    assert f'href="/jobs/{job.id}"' in page
    assert other.id not in page
    assert f'data-plan="{scenario.id}"' in page
    assert "The right foot passes through step 1." in page
    assert 'data-delete="' in page
    assert "right foot touches 0.00 s to 1.00 s; 1.80 s to" in page


def test_scenario_page_says_how_well_each_phase_is_held(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/scenarios/{fake.add_scenario().id}").text
    shown = texts(page)
    assert "The robot could stop and rest in 7 of 9 phases. It has the least room in phase 3: 2.0 cm short." in shown
    assert "3 2.00 s 2.80 s right foot, right hand only passed in motion -2.0 cm 4.0 cm 25.0 cm" in shown
    assert "0 0.00 s 1.00 s left foot, right foot yes 6.0 cm 4.0 cm 25.0 cm" in shown
    assert '<polygon class="support"' in page
    assert "where the CoM can rest in phase 3, the tightest" in shown


def test_a_sample_cannot_be_deleted_and_an_impossible_one_not_planned(fake: FakeService, browse: Browse) -> None:
    assert 'data-delete="' not in browse(f"/scenarios/{fake.add_scenario(bundled=True).id}").text
    good = robots.scenario()
    astray = good.phases[0].contacts[0].model_copy(update={"position_m": (0.0, 3.0, 0.0)})
    first = good.phases[0].model_copy(update={"contacts": [astray, *good.phases[0].contacts[1:]]})
    scenario = fake.add_scenario(given=good.model_copy(update={"phases": [first, *good.phases[1:]]}))
    page = browse(f"/scenarios/{scenario.id}").text
    assert "This scenario cannot be planned." in page
    assert "phases[0].contacts[left_foot]" in page
    assert "data-plan=" not in page


def test_a_replay_says_how_it_was_disturbed(fake: FakeService, browse: Browse, monkeypatch: pytest.MonkeyPatch) -> None:
    calm, options = (
        robots.plan_summary,
        ReplayOptions.model_validate(
            {"pushes": [{"time_s": 1.5, "impulse_ns": [3, 4, 0]}], "payload_kg": 2.5, "delay_s": 0.002, "friction": 0.2}
        ),
    )

    def disturbed(*, whole_body: bool) -> PlanMotionSummary:
        summary = calm(whole_body=whole_body)
        assert summary.replay is not None
        return summary.model_copy(update={"replay": summary.replay.model_copy(update={"options": options})})

    assert "Disturbed:" not in texts(browse(f"/plans/{fake.add_plan().id}").text)
    monkeypatch.setattr(robots, "plan_summary", disturbed)
    shown = texts(browse(f"/plans/{fake.add_plan().id}").text)
    assert (
        "Disturbed: push of 5 N s at 1.5 s on the trunk, 2.5 kg on the trunk, friction 0.2, control 2 ms late." in shown
    )


def test_a_robot_that_stays_on_its_feet_need_not_have_completed_the_motion(
    fake: FakeService, browse: Browse, monkeypatch: pytest.MonkeyPatch
) -> None:
    fallen = robots.plan_summary
    slipped = Remark(code="replay-slipped", message="A loaded foot slips by 68 mm; at most 20 mm are allowed.")

    def standing(*, whole_body: bool) -> PlanMotionSummary:
        summary = fallen(whole_body=whole_body)
        assert summary.replay is not None
        changed = {"fall_time_s": None, "collisions": 2, "remarks": [slipped]}
        return summary.model_copy(update={"replay": summary.replay.model_copy(update=changed), "warnings": []})

    monkeypatch.setattr(robots, "plan_summary", standing)
    shown = texts(browse(f"/plans/{fake.add_plan().id}").text)
    assert "Not completed: the robot does not fall, but departs from the plan." in shown
    assert "A loaded foot slips by 68 mm; at most 20 mm are allowed. replay-slipped" in shown
    assert "Colliding pairs pairs of parts that meet in the simulation and should not 2" in shown
    assert "The robot falls" not in shown


def test_plan_page_shows_certificate_replay_and_where_to_look(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan()
    page = browse(f"/plans/{job.id}").text
    shown = texts(page)
    assert "Not every check passed." in shown
    assert "CoM error, largest how far the centre of mass is from its plan 0.155 mm at most 1 mm passed" in shown
    assert "terrain -12.3 mm at least 0 m failed phase 1 left leg 4" in shown
    assert f'href="/view/?plan={job.id}&amp;t=1.250"' in page
    assert "The robot falls at 3.21 s." in shown
    assert "Foot slip, largest how far a foot slides while it should rest 4.2 mm" in shown
    times = (("check", "0.50"), ("centroidal", "2.50"), ("export", "1.00"))
    stages = [f"{STAGE_TERMS[name].meaning} {time_s} s" for name, time_s in times]
    assert [shown.index(one) for one in stages] == sorted(shown.index(one) for one in stages)
    assert "Replayed in physics, the robot falls." in shown
    assert "1 7.5 N m s 2.5 N m s 3.0 ms 2 0.75 N m s 0.25 N m s 4.0 ms" in shown


def test_a_plan_that_the_body_cannot_follow_shows_where_it_stops(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan()
    detail = "The whole body cannot go on beyond 1.24 s (phase 1), short of: torque of leg_left_4_joint."
    place = FaultItem(where="phases[1]", message="at 1.24 s: torque of leg_left_4_joint")
    problem = Problem(title="Failed", status=422, code="whole-body-failed", detail=detail, errors=[place])
    fake.change(job.id, state="failed", error=problem)
    fake.stopped[job.id] = StoppedMotion(
        time_s=1.24, phase=1, level=0, level_name="dynamics", names=["torque of leg_left_4_joint"]
    )
    page = browse(f"/plans/{job.id}").text
    shown = texts(page)
    assert shown.count(detail) == 1
    assert shown.count("leg_left_4_joint") == 1, "what stops the body is shown once"
    assert "The whole body follows the plan for 1.24 s of " in shown
    assert "Only complete motions are checked." in shown
    assert f'href="/view/?plan={job.id}&amp;t=1.240"' in page
    assert "Watch the motion" in shown
    viewer = browse(f"/view/?plan={job.id}")
    assert viewer.status_code == 200
    assert "data-moments" not in viewer.text


def test_a_failed_plan_without_a_result_has_a_page_of_its_own(
    fake: FakeService, browse: Callable[..., httpx.Response]
) -> None:
    job = fake.add_job("plan-motion", "failed", scenario_id=fake.add_scenario().id)
    answer = browse(f"/view/?plan={job.id}", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, f"/plans/{job.id}")


def test_worst_moments_are_marked_on_the_timeline_and_listed_with_the_failed_first(
    fake: FakeService, browse: Browse
) -> None:
    page = browse(f"/view/?plan={fake.add_plan(replay=True).id}").text
    first, second = (page.index(f'<option value="{time_s}">') for time_s in ("1.250", "2.500"))
    assert first < second
    assert "failed: Terrain distance, smallest -12.3 mm, leg left 4 link, 1.25 s" in page
    assert 'class="check bad"' in page
    assert 'data-at="1.250"' in page
    assert 'data-show="/ghost/" checked' in page, "a replay that falls is shown"
    assert 'data-show="/measured/"' in page


def test_curves_of_a_replayed_plan_stand_beside_what_was_planned(fake: FakeService, browse: Browse) -> None:
    drawn = browse(f"/plans/{fake.add_plan(replay=True).id}/plots.json").json()
    text = json.dumps(drawn)
    assert "left foot, replay" in text
    page = texts(browse(f"/plans/{fake.add_plan(replay=True).id}").text)
    assert "readings are the plan's, then the replay's" in page.replace("&#39;", "'")


def test_plan_page_of_the_centre_of_mass_alone(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/plans/{fake.add_plan(whole_body=False).id}").text
    assert "a certificate needs the whole body" in page
    assert "Watch the motion" not in page
    assert "data-plots=" in page


def test_plan_page_splits_the_objective_by_term(fake: FakeService, browse: Browse) -> None:
    page = browse(f"/plans/{fake.add_plan().id}").text
    shown = texts(page)
    assert "∫ |c̈|² dt 0.4 m²/s³ 10 s⁴/m² 4.0000 s" in shown
    assert "∫ |L̇|² dt 0.2 N² m² s 10 1/(N m)² 2.0000 s" in shown
    assert "−∫ log p(c) dt -11 s 1 -11.0000 s" in shown
    names = ["Negative log-likelihood, right foot", "-14.4670 s", "Forces on hands"]
    costs = shown[shown.index("Cost of the motion") :]
    assert [costs.index(one) for one in names] == sorted(costs.index(one) for one in names)
    assert "data-not-minimised" not in page


def test_bars_of_the_cost_share_one_scale() -> None:
    rows = cost_rows(robots.plan_summary(whole_body=True))
    assert [row.key for row in rows if not row.regulariser][:2] == ["com_acceleration", "momentum_rate"]
    costs = [robots.COST_TERMS[row.key] for row in rows]
    zeros = [row.x if cost > 0 else row.x + row.width for row, cost in zip(rows, costs, strict=True)]
    assert np.allclose(zeros, 100 * 11 / 15, atol=0.02)
    assert np.allclose([row.width for row in rows], 100 / 15 * np.abs(costs), atol=0.01)


def test_regularisers_of_a_wrench_are_marked_as_not_minimised(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan()
    fake.inputs[job.id]["formulation"] = "wrench"
    assert "data-not-minimised" in browse(f"/plans/{job.id}").text


def test_a_plan_of_a_version_that_wrote_no_weights_still_shows_its_terms() -> None:
    bare = robots.plan_summary(whole_body=False).model_copy(update={"weights": None})
    assert {(row.integral, row.weight) for row in cost_rows(bare)} == {("–", "–")}


def test_curves_of_a_plan_are_those_of_its_file(fake: FakeService, browse: Browse) -> None:
    job = fake.add_plan()
    drawn = browse(f"/plans/{job.id}/plots.json").json()
    columns = robots.centroidal(robots.scenario())
    assert np.allclose(drawn["columns"]["com_x_m"], columns["com_x_m"], atol=1e-5)
    assert set(drawn["columns"]["left_foot_fz_n"]) == {400.0}
    assert drawn["shades_s"][0] == [1.0, 1.8]


def test_a_failed_plan_says_its_stage_and_a_running_one_goes_on_to_the_viewer(
    fake: FakeService, browse: Browse
) -> None:
    problem = Problem(
        title="Not estimable", status=422, code="whole-body-failed", detail="No motion follows the plan.",
        errors=[FaultItem(where="stage: whole body", message="right knee at its limit")],
    )  # fmt: skip
    failed = fake.add_job("plan-motion", "failed", error=problem)
    page = browse(f"/plans/{failed.id}?watch=1").text
    assert "No motion follows the plan." in page
    assert "stage: whole body" in page
    assert "right knee at its limit" in page
    running = fake.add_job("plan-motion", "running")
    assert f'data-then="/view/?plan={running.id}&amp;play=1"' in browse(f"/plans/{running.id}?watch=1").text
    assert "data-then" not in browse(f"/plans/{running.id}").text
    assert "Watch it being computed" not in browse(f"/plans/{running.id}").text  # of no stored scenario
    stored = fake.add_job("plan-motion", "running", scenario_id="six-stairs")
    assert re.search(
        rf'href="/view/\?plan={stored.id}"[^>]*>Watch it being computed', browse(f"/plans/{stored.id}").text
    )
    ended = fake.add_job("plan-motion", "cancelled", scenario_id="six-stairs")
    assert "Watch it being computed" not in browse(f"/plans/{ended.id}").text


def test_jobs_and_plans_lead_to_each_other(fake: FakeService, browse: Browse) -> None:
    plan, estimate = fake.add_plan(), fake.add_job(state="succeeded")
    there = browse(f"/jobs/{plan.id}")
    assert there.status_code == 303
    assert there.headers["location"] == f"/plans/{plan.id}"
    back = browse(f"/plans/{estimate.id}")
    assert back.status_code == 303
    assert back.headers["location"] == f"/jobs/{estimate.id}"
    assert browse(f"/plans/{estimate.id}/plots.json").status_code == 404


def test_chosen_durations_stand_beside_the_given_ones_and_can_be_kept(fake: FakeService, browse: Browse) -> None:
    given = robots.scenario()
    result = [
        PhaseDuration(given_s=phase.duration_s, chosen_s=phase.duration_s * (0.7 if k == 1 else 1.4 if k == 2 else 1.0))
        for k, phase in enumerate(given.phases)
    ]
    job = fake.add_plan(given)
    assert "data-durations" not in browse(f"/plans/{job.id}").text
    plain = robots.plan_result(fake.inputs[job.id], fake.plans[job.id])
    summary = plain.summary | {"phase_durations": [phase.model_dump() for phase in result]}
    fake.results[job.id] = plain.model_copy(update={"summary": summary})
    page = browse(f"/plans/{job.id}").text
    shown = texts(page)
    assert "The durations are between 0.70 (phase 1) and 1.40 times (phase 2) those of the scenario." in shown
    assert "1 left foot, right hand 0.80 s 0.560 s 0.70" in shown
    assert "data-keep" in page


def test_bars_of_both_timings_share_one_axis() -> None:
    given = robots.scenario()
    result = [PhaseDuration(given_s=phase.duration_s, chosen_s=2.0 * phase.duration_s) for phase in given.phases]
    drawn = chosen_durations(result, given)
    assert drawn.chosen[-1].x + drawn.chosen[-1].width == 100.0
    assert drawn.given[-1].x + drawn.given[-1].width == 50.0
    assert [row.share for row in drawn.rows] == [2.0] * len(given.phases)


def test_forces_are_drawn_as_they_hold(fake: FakeService, browse: Browse) -> None:
    """Constant ones as steps, splines as lines."""
    job = fake.add_plan()

    def steps() -> list[bool]:
        return [row["steps"] for row in browse(f"/plans/{job.id}/plots.json").json()["rows"]]

    assert steps() == [False, False, False, False, False, True]
    plain = robots.plan_result(fake.inputs[job.id], fake.plans[job.id])
    fake.results[job.id] = plain.model_copy(update={"summary": plain.summary | {"shape": "cubic"}})
    assert steps() == [False] * 6
