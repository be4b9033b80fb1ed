"""``stridelab read-terrain``: from the file of a terrain to planned contacts; bad files leave nothing behind."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.cli.results import EXIT_CODES
from stridelab.errors import InvalidInput, NotFound, StridelabError, UnreadableFile
from support.terrain_scans import flight_rectangles, scan_bar, scan_rectangles


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


def test_a_noisy_cloud_becomes_a_contact_sequence_on_stairs_with_a_rail() -> None:
    rng = np.random.default_rng(20)
    level, risers = flight_rectangles(0.14, 0.3, 3, 1.2, 1.2)
    rail = scan_bar(rng, ((0.0, -0.5, 0.9), (0.6, -0.5, 1.18)), 0.02, 0.02, 0.003)
    points_m = np.concatenate([scan_rectangles(rng, [*level, *risers], 0.02, 0.003), rail])
    np.savetxt("flight.xyz", points_m, fmt="%.4f")
    code, output = typed("read-terrain", "flight.xyz", "--start=-0.6,0", "--goal=1.3,0")
    assert code == 0, output
    output = " ".join(output.split())
    assert "4 surfaces, 0.00 to 0.42 m high, 1 rail" in output
    assert "stairs: 3 treads, rise 14.0 cm" in output
    assert "1 rail" in output.partition("stairs:")[2]
    assert "mm of noise" in output
    code, output = typed("plan-contacts", "flight.task.json")
    assert code == 0, output


def test_an_image_needs_its_cell_and_height() -> None:
    grey = np.zeros((60, 100), dtype=np.uint8)
    grey[:, 60:] = 10
    Image.fromarray(grey).save("map.png")
    code, output = typed("read-terrain", "map.png", "--start=-0.5,0", "--goal=0.7,0")
    assert code == EXIT_CODES[UnreadableFile], output
    code, output = typed("read-terrain", "map.png", "--start=-0.5,0", "--goal=0.7,0", "--cell=0.02", "--height=0.01")
    assert code == 0, output
    assert "2 surfaces, 0.00 to 0.10 m high" in output


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
