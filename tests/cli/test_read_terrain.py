"""``stridelab read-terrain``: from the mesh of a terrain to planned contacts; bad files leave nothing behind."""

import json
from pathlib import Path

import pytest
import trimesh
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.results import EXIT_CODES
from stridelab.errors import InvalidInput, NotFound, StridelabError, UnreadableFile


@pytest.fixture(autouse=True)
def _step_in_millimetres(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``step.stl``, a floor and a platform of 10 cm in millimetres, in the current folder."""
    monkeypatch.chdir(tmp_path)
    move = trimesh.transformations.translation_matrix
    floor = trimesh.creation.box(extents=(1200, 1000, 100), transform=move((-100, 0, -50)))
    platform = trimesh.creation.box(extents=(1200, 1000, 100), transform=move((1100, 0, 50)))
    trimesh.util.concatenate([floor, platform]).export("step.stl")


def typed(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def test_a_mesh_becomes_a_contact_sequence() -> None:
    code, output = typed("read-terrain", "step.stl", "--unit", "mm", "--start=0,0", "--goal", "1.0,0", "--robot", "g1")
    assert code == 0, output
    assert "2 surfaces, 0.00 to 0.10 m high" in output
    task = json.loads(Path("step.task.json").read_text(encoding="utf-8"))
    assert (task["robot"], len(task["terrain"])) == ("g1", 2)
    assert [one["position_m"][2] for one in task["goal"]["contacts"]] == pytest.approx([0.1, 0.1])
    code, output = typed("plan-contacts", "step.task.json")
    assert code == 0, output
    scenario = json.loads(Path("step.task-contacts/scenario.json").read_text(encoding="utf-8"))
    heights = {round(one["position_m"][2], 3) for phase in scenario["phases"] for one in phase["contacts"]}
    assert heights == {0.0, 0.1}


@pytest.mark.parametrize(
    ("kind", "said", "arguments"),
    [
        (UnreadableFile, "State its unit", ("step.stl", "--start=0,0", "--goal=1,0")),
        (UnreadableFile, "damaged", ("letters.ply", "--start=0,0", "--goal=1,0")),
        (NotFound, "There is no file", ("none.stl", "--start=0,0", "--goal=1,0")),
        (NotFound, "nobody", ("step.stl", "--unit=mm", "--start=0,0", "--goal=1,0", "--robot=nobody")),
        (InvalidInput, "--goal", ("step.stl", "--unit=mm", "--start=0,0", "--goal=1;0")),
        (InvalidInput, "Goal, left foot", ("step.stl", "--unit=mm", "--start=0,0", "--goal=9,0")),
        (InvalidInput, "no surface on which", ("wall.obj", "--start=0,0", "--goal=1,0")),
    ],
)
def test_what_cannot_be_read_leaves_nothing_behind(
    kind: type[StridelabError], said: str, arguments: tuple[str, ...]
) -> None:
    Path("letters.ply").write_text("no mesh at all", encoding="utf-8")
    Path("wall.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n", encoding="utf-8")
    before = sorted(Path().iterdir())
    code, output = typed("read-terrain", *arguments)
    assert code == EXIT_CODES[kind], output
    assert said in " ".join(output.split())
    assert sorted(Path().iterdir()) == before
