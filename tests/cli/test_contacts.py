"""``stridelab plan-contacts``: from a file or a scenario to a scenario in a folder."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.contacts import task_of
from stridelab.cli.results import EXIT_CODES
from stridelab.errors import InvalidInput
from stridelab.pipelines.scenarios.scenario_files import bundled_names, read_document, read_scenario
from stridelab.schemas.jobs import JobResult
from support.robots.scenario_bodies import box, planks, task


def typed(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["plan-contacts", *arguments])
    return result.exit_code, result.output


def test_a_task_becomes_a_folder_with_a_scenario(tmp_path: Path) -> None:
    file = tmp_path / "door.json"
    file.write_text(json.dumps(task([box("floor", (-1.0, 2.0), 0.0)], 0.6, 0.0)))
    code, output = typed(str(file), "--out", str(tmp_path / "out"))
    assert code == 0, output
    assert "right_foot" in output
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"scenario.json", "result.json", "references.bib"}
    code, printed = typed(str(tmp_path / "out" / "scenario.json"), "--out", str(tmp_path / "again"), "--json")
    result = JobResult.model_validate(json.loads(printed[printed.index("{") :]))
    assert code == 0
    assert result.kind == "plan-contacts"
    scenarios = [json.loads((tmp_path / name / "scenario.json").read_text()) for name in ("out", "again")]
    assert scenarios[0]["name"] == "door"
    assert scenarios[0]["phases"] == scenarios[1]["phases"]


@pytest.mark.parametrize("name", bundled_names())
def test_every_bundled_scenario_is_a_task(name: str) -> None:
    scenario = read_scenario(name)
    task = task_of(read_document(name), name)
    assert (task.robot, task.terrain) == (scenario.robot, scenario.terrain)
    assert (task.start.contacts, task.goal.contacts) == (scenario.phases[0].contacts, scenario.phases[-1].contacts)


def test_a_wrong_field_is_named_as_people_write_it() -> None:
    wrong = task([box("floor", (-1.0, 2.0), 0.0)], 0.6, 0.0)
    wrong["goal"]["contacts"][1]["position_m"][2] = "high"
    with pytest.raises(InvalidInput) as refusal:
        task_of(wrong, "x")
    effector = wrong["goal"]["contacts"][1]["effector"]
    assert [fault.where for fault in refusal.value.faults] == [f"goal.contacts[{effector}].position_m[2]"]


def test_an_end_that_cannot_be_held_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    wrong = task([box("floor", (-1.0, 2.0), 0.0)], 0.6, 0.0)
    wrong["goal"]["contacts"][0]["position_m"][2] = 0.2
    file = tmp_path / "door.json"
    file.write_text(json.dumps(wrong))
    code, output = typed(str(file), "--out", str(tmp_path / "out"))
    assert code == EXIT_CODES[InvalidInput]
    assert f"goal.contacts[{wrong['goal']['contacts'][0]['effector']}]" in output
    assert not (tmp_path / "out").exists()


def test_an_impossible_task_is_explained_and_leaves_nothing(tmp_path: Path) -> None:
    file = tmp_path / "gap.json"
    file.write_text(json.dumps(planks(0.6)))
    code, output = typed(str(file), "--out", str(tmp_path / "out"))
    assert code != 0
    assert "plank 1" in output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("document", "where"),
    [([], "robot"), ({"robot": "talos", "phases": []}, "terrain"), ({"robot": "talos", "phases": [{}]}, "start")],
)
def test_a_file_that_is_no_task_is_named(document: object, where: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        task_of(document, "x")
    assert any(where in fault.where.lower() for fault in refusal.value.faults)


def test_a_course_is_planned_like_a_task(tmp_path: Path) -> None:
    file = tmp_path / "stones.json"
    file.write_text(json.dumps({"robot": "talos", "elements": [{"kind": "stones", "number": 3}]}))
    code, output = typed(str(file), "--out", str(tmp_path / "out"))
    assert code == 0, output
    scenario = json.loads((tmp_path / "out" / "scenario.json").read_text())
    assert scenario["name"] == "stones"
    assert {"1 stone 1", "1 stone 3", "end"} <= {surface["name"] for surface in scenario["terrain"]}
    with pytest.raises(InvalidInput) as refused:
        task_of({"robot": "talos", "elements": [{"kind": "stairs", "number": 0}]}, "stairs")
    assert (refused.value.code, refused.value.faults[0].where) == ("course-invalid", "elements[0].number")
