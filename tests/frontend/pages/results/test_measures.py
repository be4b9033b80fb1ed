"""The page of measures of gait: the main values first, every measure with both sides, and what is missing."""

import io
import re
from collections.abc import Callable
from typing import Any

import httpx
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stridelab.schemas.base import Remark
from stridelab.schemas.measures import MEASURE_TITLES, BodySide
from stridelab.schemas.recordings import SubjectFields
from stridelab_web.pages.results.measures import measure_rows, measures_headline, measures_of, steps_by_side
from support.fakes.results import MEASURES_KIND, measures_result, measures_summary
from support.fakes.service import FakeService

Browse = Callable[..., httpx.Response]


@pytest.fixture
def page(fake: FakeService, browse: Browse) -> str:
    answer = browse(f"/jobs/{fake.add_job(MEASURES_KIND, 'succeeded').id}")
    assert answer.status_code == 200
    return answer.text


def test_the_page_of_a_recording_begins_with_its_newest_measures(fake: FakeService, browse: Browse) -> None:
    walks = [fake.add_recording(f"walk_{k}.c3d", session_id="gait") for k in (1, 2)]
    before = text_of(browse(f"/recordings/{walks[0].id}").text)
    assert "Measure this walk" in before
    assert "Measure the 2 walks of the session" in before
    pooled = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[pooled.id] = {"recording_ids": [walk.id for walk in walks]}
    for address in (f"/recordings/{walks[0].id}", "/recordings?session_id=gait"):
        page = browse(address).text
        assert f'data-gait-result="{pooled.id}"' in page
        assert page.index("data-gait-result") < page.index("Upload" if "session" in address else "Measured intervals")
        assert "with a margin of stability of 73 mm (46 to 99, 95 %) sideways." in text_of(page)
        assert "2 left out" in text_of(page)
        assert "Measure this walk" not in page
    own = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[own.id] = {"recording_ids": [walks[1].id]}
    again = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[again.id] = fake.inputs[pooled.id]
    assert f'data-gait-result="{own.id}"' in browse(f"/recordings/{walks[1].id}").text, "its own before the session's"
    assert f'data-gait-result="{again.id}"' in browse(f"/recordings/{walks[0].id}").text, "the newest"
    assert "data-gait-result" not in browse("/recordings").text


@pytest.mark.parametrize("later", [{"filename": "standing.c3d", "still": True}, {"filename": "walk_3.c3d"}])
def test_a_session_shows_its_measures_whatever_was_uploaded_last(
    fake: FakeService, browse: Browse, later: dict[str, Any]
) -> None:
    """The newest recording of the list has no measures: a static trial never has."""
    walks = [fake.add_recording(f"walk_{k}.c3d", session_id="gait") for k in (1, 2)]
    pooled = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[pooled.id] = {"recording_ids": [walk.id for walk in walks]}
    newest = fake.add_recording(session_id="gait", **later)
    page = browse("/recordings?session_id=gait").text
    assert page.index(newest.filename) < page.index("walk_1.c3d"), "it is listed first"
    assert f'data-gait-result="{pooled.id}"' in page


def test_the_viewer_has_the_steps_of_the_recording(fake: FakeService, browse: Browse) -> None:
    walk = fake.add_recording()
    job = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[job.id] = {"recording_ids": [walk.id]}
    table = io.BytesIO()
    own, other = [walk.id] * 3, ["another"]
    pq.write_table(pa.table({"recording_id": own + other, "strike_s": [1.6, 0.5, 1.0, 9.0]}), table)
    fake.com = table.getvalue()
    page = browse(f"/view/?recording={walk.id}&job={job.id}").text
    assert "data-steps='[[0.5, 1.0], [1.0, 1.6]]'" in page
    assert re.search(r'data-do="cycle"\s+title', page)
    plain = browse(f"/view/?recording={walk.id}").text
    assert re.search(r'data-do="cycle" hidden', plain)


def test_what_limits_the_measures_is_beside_them(fake: FakeService, browse: Browse) -> None:
    walk = fake.add_recording()
    job = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[job.id] = {"recording_ids": [walk.id]}
    result = measures_result(fake.inputs[job.id])
    result.summary["warnings"] = [{"code": "weight-beside-plates", "message": "The plates carry 80 %."}]
    fake.results[job.id] = result
    assert re.search(r"data-gait-caution>The plates carry 80 %\.", browse(f"/recordings/{walk.id}").text)


MIXED = {
    "code": "speeds-mixed",
    "message": "The recordings have speeds from 0.32 to 2.17 m/s. Most measures depend on the speed: report the "
    "conditions one by one.",
}


def test_mixed_speeds_are_said_beside_the_values_and_in_the_language(fake: FakeService, browse: Browse) -> None:
    """Beside what is left out, which was in one sentence with it and stayed English."""
    walks = [fake.add_recording(f"walk_{k}.c3d", session_id="gait") for k in (1, 2)]
    job = fake.add_job(MEASURES_KIND, "succeeded")
    fake.inputs[job.id] = {"recording_ids": [walk.id for walk in walks]}
    result = measures_result(fake.inputs[job.id])
    result.summary["warnings"] = [MIXED]
    fake.results[job.id] = result
    for address, mark in ((f"/recordings/{walks[0].id}", "data-gait-caution"), (f"/jobs/{job.id}", "data-caution")):
        said = re.search(rf"{mark}[^>]*>([^<]*)", browse(address, headers={"Accept-Language": "de"}).text)
        assert said is not None
        assert said[1].startswith("Die Aufnahmen haben Geschwindigkeiten von 0.32 bis 2.17 m/s."), address


def test_remarks_of_one_code_are_one_remark_with_its_similar_ones(fake: FakeService, browse: Browse) -> None:
    """Twenty recordings had twenty remarks on their clocks, before all others."""
    job = fake.add_job(MEASURES_KIND, "succeeded")
    result = measures_result({"recording_ids": ["a"]})
    late = [{"code": "latency-applied", "message": f"The force was read {k} ms later."} for k in (3, 4, 5)]
    result.summary["warnings"] = [late[0], {"code": "head-missing", "message": "No head."}, *late[1:]]
    fake.results[job.id] = result
    page = browse(f"/jobs/{job.id}").text
    assert page.count("<code>latency-applied</code>") == 1
    assert "Similar remarks of other recordings: 2" in page
    assert page.index("read 3 ms later") < page.index("read 4 ms later") < page.index("read 5 ms later")
    assert page.index("read 5 ms later") < page.index("No head.")


def text_of(html: str) -> str:
    return " ".join(re.sub(r"<[^>]+>", " ", html).split())


def test_values_are_in_the_units_of_the_field_with_their_interval_and_sides() -> None:
    rows = {row.name: row for row in measure_rows(measures_summary())}
    shown = {name: (row.mean, row.unit, row.interval, row.left, row.right) for name, row in rows.items()}
    assert shown["walking_speed"] == ("1.21", "m/s", "1.20 to 1.22", "1.21", "1.21")
    assert shown["step_length"] == ("0.678", "m", "0.659 to 0.697", "0.672", "0.684")
    assert shown["step_width"] == ("105", "mm", "98 to 112", "107", "103")
    assert shown["margin_of_stability_ap_contact"] == ("0", "mm", "-40 to 39", "11", "-12")
    assert shown["double_support_share"] == ("25", "%", "15 to 35", "24", "26")
    assert shown["energy_recovery"] == ("55", "%", "", "56", "54"), "no interval is known"
    assert shown["angular_momentum_range_x"] == ("0.014", "", "0.011 to 0.017", "0.014", "0.014")
    assert shown["foot_placement_residual"] == ("14", "mm", "12 to 16", "", "")
    assert (rows["step_length"].symmetry, rows["step_width"].symmetry) == ("-1.8 %", "")


def test_rows_are_in_the_order_of_the_titles() -> None:
    names = [row.name for row in measure_rows(measures_summary())]
    assert names[:3] == ["walking_speed", "step_length", "step_width"]
    assert names == [name for name in MEASURE_TITLES if name in names]


def test_a_measure_of_a_later_version_is_shown_under_its_name() -> None:
    plain = measures_summary()
    later = plain.measures[0].model_copy(update={"name": "toe_clearance", "unit": "rad"})
    last = measure_rows(plain.model_copy(update={"measures": [later, *plain.measures]}))[-1]
    assert (last.title, last.mean, last.unit) == ("Toe clearance", "0.678", "rad")


def test_the_headline_gives_steps_speed_and_margin() -> None:
    assert measures_headline(measures_summary()) == (
        "7 steps in 2 recordings at 1.21 m/s (1.20 to 1.22, 95 %) "
        "with a margin of stability of 73 mm (46 to 99, 95 %) sideways."
    )
    bare = measures_summary().model_copy(update={"measures": [], "steps": 1, "n_recordings": 1})
    assert measures_headline(bare) == "1 step in 1 recording. Few steps: the intervals below are wide."


def test_the_headline_of_two_steps_leaves_their_intervals_to_the_values() -> None:
    plain = measures_summary()
    two = [one.model_copy(update={"n": 2}) for one in plain.measures]
    assert measures_headline(plain.model_copy(update={"measures": two, "steps": 2})) == (
        "2 steps in 2 recordings at 1.21 m/s with a margin of stability of 73 mm sideways. "
        "Few steps: the intervals below are wide."
    )


@pytest.mark.parametrize(
    ("sides", "codes", "text"),
    [
        ({"left": 2, "right": 3}, (), "2 left, 3 right"),
        ({"left": 0, "right": 3}, ("one-foot-marked",), "right foot only: 3 steps; the left foot is not marked"),
        ({"left": 1}, (), "left foot only: 1 step; none of the right foot is measured"),
        ({}, (), "none measured"),
    ],
)
def test_a_foot_without_steps_is_named_with_the_reason(
    sides: dict[BodySide, int], codes: tuple[str, ...], text: str
) -> None:
    remarks = [Remark(code=code, message="why") for code in codes]
    assert steps_by_side(measures_summary().model_copy(update={"sides": sides, "warnings": remarks})) == text


def test_six_values_are_above_the_table_and_double_support_stands_in_for_energy() -> None:
    names = ["walking_speed", "step_length", "step_width", "margin_of_stability_ml_min"]
    names += ["margin_of_stability_ap_contact", "energy_recovery"]
    done = measures_result({})
    assert [row.name for row in measures_of(done)["main"]] == names
    without = [one for one in done.summary["measures"] if one["name"] != "energy_recovery"]
    done = done.model_copy(update={"summary": done.summary | {"measures": without}})
    assert [row.name for row in measures_of(done)["main"]] == [*names[:5], "double_support_share"]


def test_the_page_shows_the_main_values_then_all_of_them(page: str) -> None:
    main = re.findall(r'<div data-main="(\w+)">(.*?)</div>', page, re.DOTALL)
    assert text_of(dict(main)["margin_of_stability_ml_min"]) == (
        "Margin of stability, sideways 73 mm 46 to 99 mm (95&nbsp;%) left 72 · right 74"
    )
    rows = dict(re.findall(r'<tr data-measure="(\w+)">(.*?)</tr>', page, re.DOTALL))
    assert len(rows) == 10
    assert text_of(rows["energy_recovery"]) == "Recovery of mechanical energy 55 % – 56 54 +3.6 % 7"
    assert page.index("data-headline") < page.index("data-main") < page.index("data-measure=")
    assert "Height</dt><dd>not known" in page
    for name in ("measures.csv", "xcom.csv", "measures.parquet", "xcom.parquet"):
        assert f'/artifacts/{name}"' in page
    assert " style=" not in page


def test_what_is_missing_has_its_reason_and_contradictions_come_first(page: str) -> None:
    missing = text_of(page[page.index('id="missing-h"') : page.index('id="trials-h"')])
    assert "Positive work of the left leg : One plate. no-separate-forces" in missing
    assert "turn.c3d is left out: The walk turns. not-walking" in missing
    assert "off.c3d" not in missing
    assert page.index("Sentence of the plates.") < page.index("data-headline")
    assert page.count('data-verdict="contradicted"') == 1
    assert page.count('<tr data-trial="good">') == 2


def test_without_contradictions_there_is_no_alarm(fake: FakeService, browse: Browse) -> None:
    job = fake.add_job(MEASURES_KIND, "succeeded")
    done = measures_result({})
    clean: dict[str, Any] = {"left_out": [], "not_measured": [], "warnings": []}
    fake.results[job.id] = done.model_copy(update={"summary": done.summary | clean})
    page = browse(f"/jobs/{job.id}").text
    assert 'data-verdict="contradicted"' not in page
    assert 'id="missing-h"' not in page
    waiting = browse(f"/jobs/{fake.add_job(MEASURES_KIND).id}")
    assert waiting.status_code == 200
    assert "data-cancel" in waiting.text
    assert "data-headline" not in waiting.text


def test_the_page_leads_back_to_a_single_recording(fake: FakeService, browse: Browse) -> None:
    walk, other = fake.add_recording("walk.c3d"), fake.add_recording("other.c3d")
    for ids, linked in (([walk.id], True), ([walk.id, other.id], False), (["deleted"], False)):
        job = fake.add_job(MEASURES_KIND, "succeeded")
        fake.results[job.id] = measures_result({"recording_ids": ids})
        crumbs = browse(f"/jobs/{job.id}").text.partition('<p class="crumbs">')[2].partition("</p>")[0]
        assert (f'href="/recordings/{walk.id}"' in crumbs) == linked


def test_a_session_measures_its_walks_together(fake: FakeService, browse: Browse) -> None:
    walks = [fake.add_recording(f"walk_{k}.c3d", session_id="s1") for k in (1, 2)]
    still = fake.add_recording("standing.c3d", session_id="s1", still=True)
    lone = fake.add_recording("lone.c3d", session_id="s2")
    for shown in (walks[0], still):
        page = browse(f"/recordings/{shown.id}").text
        (ids,) = re.findall(r'data-session-measures="([^"]*)">Measures of gait of\s+2 recordings<', page)
        assert ids.split(" ") == [walk.id for walk in walks]
    assert "data-session-measures" not in browse(f"/recordings/{lone.id}").text


GROUP: dict[str, Any] = {
    "name": "step_length", "unit": "m", "value": 0.678, "n_people": 7, "mean": 0.6, "between_sd": 0.03,
    "difference": 0.078, "ci95": (-0.002, 0.158), "z": 2.6, "z_ci95": (0.9, 4.3),
}  # fmt: skip
CHANGE: dict[str, Any] = {
    "name": "walking_speed", "unit": "m/s", "before": 1.0, "after": 1.212, "n_before": 2, "n_after": 3, "change": 0.212,
    "ci95": (0.1, 0.324),
}  # fmt: skip


def reported(fake: FakeService, browse: Browse, **fields: Any) -> str:
    """The page of a report whose summary has ``fields`` beside the measures."""
    job = fake.add_job("gait-report", "succeeded")
    done = measures_result({"recording_ids": ["r1", "r2"]})
    fake.results[job.id] = done.model_copy(update={"kind": "gait-report", "summary": done.summary | fields})
    answer = browse(f"/jobs/{job.id}")
    assert answer.status_code == 200
    return answer.text


def test_a_report_shows_the_person_beside_the_group(fake: FakeService, browse: Browse) -> None:
    page = reported(fake, browse, reference=[GROUP], reference_people=7)
    (row,) = re.findall(r'<tr data-reference="step_length">(.*?)</tr>', page, re.DOTALL)
    assert text_of(row) == "Step length m 0.678 0.600 ± 0.030 7 +0.078 -0.002 to 0.158 +2.6 0.9 to 4.3"
    assert "7 people of the group" in page
    assert 'id="changes-h"' not in page


def test_intervals_beside_few_people_are_not_given_as_numbers(fake: FakeService, browse: Browse) -> None:
    page = reported(fake, browse, reference=[GROUP | {"n_people": 4}], reference_people=4)
    (row,) = re.findall(r'<tr data-reference="step_length">(.*?)</tr>', page, re.DOTALL)
    assert text_of(row) == "Step length m 0.678 0.600 ± 0.030 4 +0.078 means nothing +2.6 means nothing"


def test_a_report_shows_the_change_and_marks_a_clear_one(fake: FakeService, browse: Browse) -> None:
    vague = CHANGE | {"name": "step_length", "unit": "m", "ci95": None, "change": -0.0001}
    page = reported(fake, browse, changes=[vague, CHANGE])
    rows = re.findall(r'<tr data-change="(\w+)">(.*?)</tr>', page, re.DOTALL)
    assert [name for name, _ in rows] == ["walking_speed", "step_length"], "in the order of the titles"
    assert text_of(rows[0][1]) == "Walking speed m/s 1.00 1.21 2, 3 +0.21 0.10 to 0.32"
    assert text_of(rows[1][1]) == "Step length m 1.000 1.212 2, 3 0.000 –"
    assert [" best" in row for _, row in rows] == [True, False]
    assert 'id="reference-h"' not in page


def test_results_of_earlier_versions_have_no_intervals(fake: FakeService, browse: Browse) -> None:
    later = ("difference", "ci95", "z_ci95")
    page = reported(fake, browse, reference=[{k: v for k, v in GROUP.items() if k not in later}], reference_people=7)
    (row,) = re.findall(r'<tr data-reference="step_length">(.*?)</tr>', page, re.DOTALL)
    assert text_of(row) == "Step length m 0.678 0.600 ± 0.030 7 – – +2.6 –"


def test_a_report_can_be_compared_with_other_walks_by_person_and_day(fake: FakeService, browse: Browse) -> None:
    walk = fake.add_recording("walk.c3d", session_id="s1")
    fake.add_recording("own.c3d", session_id="s1")
    named = SubjectFields(name="P2")
    pair = [fake.add_recording(f"other_{k}.c3d", session_id="s2", subject=named) for k in (1, 2)]
    fake.add_recording("standing.c3d", session_id="s2", still=True)
    lone = fake.add_recording("lone.c3d")
    page = browse(f"/recordings/{walk.id}").text
    groups = dict(re.findall(r'<tr data-group="([^"]*)"><th scope="row" class="file">([^<]*)<', page))
    assert groups == {" ".join(sorted(one.id for one in pair)): "P2", lone.id: "lone.c3d"}
