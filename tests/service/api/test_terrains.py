"""Terrains over HTTP: surfaces of an uploaded file, the task of crossing them, and files that are refused."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from stridelab.client import Client, ProblemError
from stridelab.schemas.scenarios import ReadTerrain
from stridelab.service.api.terrains import endpoints
from stridelab.service.auth.callers import needed_scope
from support.service.terrain_files import CODES, HOSTILE, PACKED, RISE_M, STAIRS, stairs
from support.service.web_server import Served, refusal_code

TERRAINS = "/api/v1/terrains"


def send(http: httpx.Client, content: bytes, filename: str = "stairs.stl", **fields: str) -> httpx.Response:
    return http.post(TERRAINS, files={"file": (filename, content)}, data=fields, timeout=120.0)


def heights_m(read: ReadTerrain) -> list[float]:
    return sorted(one.center_m[2] + 0.5 * one.size_m[2] for one in read.terrain if one.kind == "box")


def cross(http: httpx.Client, surfaces: list[Any], **fields: Any) -> httpx.Response:
    body = {"robot": "talos", "terrain": surfaces, "start_m": [0.0, 0.0], "goal_m": [2.0, 0.0], **fields}
    return http.post(f"{TERRAINS}/crossing", json=body)


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0), ("", 1.0)])
def test_surfaces_of_a_file_are_answered_and_nothing_is_stored(
    http: httpx.Client, service: Served, unit: str, scale: float
) -> None:
    before = service.stored_files()
    answer = send(http, stairs(scale), unit=unit)
    assert answer.status_code == 200, answer.text
    read = ReadTerrain.model_validate(answer.json())
    assert heights_m(read) == pytest.approx([0.0, RISE_M, 2 * RISE_M, 3 * RISE_M], abs=1e-5)
    assert service.stored_files() == before


def test_the_axis_that_points_up_is_stated(http: httpx.Client) -> None:
    """Glb is y up by its standard; the same file read as z up has other heights, which a remark tells."""
    content = stairs(ending="glb")
    lying = send(http, content, "stairs.glb")
    assert any("another axis may point up" in remark for remark in lying.json()["remarks"])
    upright = send(http, content, "stairs.glb", up="+z")
    assert upright.status_code == 200, upright.text
    assert heights_m(ReadTerrain.model_validate(upright.json()))[-1] == pytest.approx(3 * RISE_M, abs=1e-5)
    half_width_m = STAIRS[0][0][1] / 2
    read = ReadTerrain.model_validate(lying.json())
    read = read.model_copy(update={"terrain": [one for one in read.terrain if one.name.startswith("surface")]})
    sides_m = heights_m(read)
    assert sides_m == pytest.approx([half_width_m] * max(len(sides_m), 1), abs=1e-5)


@pytest.mark.parametrize(("filename", "make"), HOSTILE.values(), ids=HOSTILE.keys())
def test_a_file_that_is_no_terrain_is_refused_by_name(
    http: httpx.Client, service: Served, filename: str, make: Callable[[], bytes]
) -> None:
    before = service.stored_files()
    status, code = refusal_code(answer := send(http, make(), filename))
    assert status == 422, answer.text
    assert code.startswith(CODES)
    (fault, *_) = answer.json()["errors"]
    assert fault["where"] in {filename, "recording", PACKED}
    assert "uploaded-terrain" not in answer.text
    assert service.stored_files() == before


def test_a_grey_image_is_read_with_its_cell_and_height(http: httpx.Client, service: Served, tmp_path: Path) -> None:
    """Two levels of 1 m, black and white, 0.2 m apart; without cell and height the missing fields are named."""
    file = tmp_path / "steps.png"
    Image.fromarray(np.repeat(np.array([[0] * 50 + [255] * 50], np.uint8), 50, axis=0)).save(file)
    bare = send(http, file.read_bytes(), "steps.png")
    assert refusal_code(bare) == (422, "terrain-file-unreadable")
    assert [fault["where"] for fault in bare.json()["errors"]] == ["steps.png", "cell_m", "height_range_m"]
    half = send(http, file.read_bytes(), "steps.png", cell_m="0.02")
    assert "state height_range_m" in half.json()["detail"]
    with Client(service.base_url) as client:
        read = client.read_terrain(file, cell_m=0.02, height_range_m=0.2)
    assert heights_m(read) == pytest.approx([0.0, 0.2], abs=1e-3)


def test_an_empty_form_and_unknown_fields_are_named(http: httpx.Client) -> None:
    assert refusal_code(send(http, b"")) == (422, "empty-file")
    assert refusal_code(http.post(TERRAINS, data={"unit": "m"}, files={"other": b"x"})) == (422, "file-missing")
    answer = send(http, stairs(), unit="inch", up="up", robot="talos", cell_m="wide", height_range_m="-1")
    assert refusal_code(answer) == (422, "invalid-request")
    named = {fault["where"] for fault in answer.json()["errors"]}
    assert named == {"unit", "up", "robot", "cell_m", "height_range_m"}
    assert http.post(TERRAINS, json={"file": "x"}).json()["code"] == "unsupported-media-type"


def test_a_wrong_unit_is_recognised_by_the_width(http: httpx.Client) -> None:
    answer = send(http, stairs(1000.0))
    assert refusal_code(answer) == (422, "terrain-mesh-unreadable")
    assert "m wide" in answer.json()["detail"]


def test_a_file_that_takes_too_long_is_refused_by_name(
    http: httpx.Client, service: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoints, "READING_TIMEOUT_S", 0.01)
    began = time.monotonic()
    assert refusal_code(send(http, stairs())) == (422, "parser-timed-out")
    assert time.monotonic() - began < 30.0


def test_reading_needs_the_scope_of_uploads() -> None:
    """It stores nothing, but takes a minute of a processor, as a proposed marker set does."""
    assert needed_scope("http", "POST", TERRAINS) == needed_scope("http", "POST", "/api/v1/robots") == "submit"
    assert needed_scope("http", "POST", f"{TERRAINS}/crossing") == "submit"


def test_a_read_terrain_is_crossed_by_planned_contacts(http: httpx.Client, service: Served) -> None:
    terrain = send(http, stairs()).json()["terrain"]
    answer = cross(http, terrain, friction=0.5, name="Stairs")
    assert answer.status_code == 200, answer.text
    task = answer.json()
    assert {contact["position_m"][2] for contact in task["start"]["contacts"]} == {0.0}
    assert [c["position_m"][2] for c in task["goal"]["contacts"]] == pytest.approx([3 * RISE_M] * 2, abs=1e-5)
    assert (task["robot"], task["friction"], task["name"]) == ("talos", 0.5, "Stairs")
    accepted = http.post("/api/v1/jobs/plan-contacts", json=task)
    assert accepted.status_code == 202, accepted.text
    http.delete(f"/api/v1/jobs/{accepted.json()['id']}")


def test_rails_and_walls_stay_and_carry_no_foot(http: httpx.Client) -> None:
    floor = {"kind": "box", "name": "floor", "center_m": [1.0, 0.0, -0.1], "size_m": [4.0, 2.0, 0.2], "yaw_rad": 0.0}
    wall = {
        "kind": "box",
        "name": "wall",
        "center_m": [0.0, 0.0, 1.0],
        "size_m": [2.0, 2.0, 0.1],
        "orientation_wxyz": [0.7071068, 0.0, 0.7071068, 0.0],
    }
    rail = {"kind": "rail", "name": "rail", "from_m": [0.0, -0.6, 0.9], "to_m": [2.0, -0.6, 0.9], "radius_m": 0.02}
    answer = cross(http, [floor, wall, rail])
    assert answer.status_code == 200, answer.text
    task = answer.json()
    assert [surface["name"] for surface in task["terrain"]] == ["floor", "wall", "rail"]
    assert {contact["position_m"][2] for contact in task["start"]["contacts"]} == {0.0}


@pytest.mark.parametrize(
    ("fields", "status", "code", "where"),
    [
        ({"goal_m": [9.0, 0.0]}, 422, "terrain-without-foothold", "goal, left foot"),
        ({"goal_m": [0.1, 0.0]}, 422, "crossing-too-short", "goal"),
        ({"robot": "nobody"}, 404, "robot-not-found", None),
        ({"terrain": []}, 422, "invalid-request", "terrain"),
        ({"start_m": [0.0]}, 422, "invalid-request", "start_m.1"),
        ({"friction": 9.0}, 422, "scenario-invalid", "friction"),
    ],
)
def test_a_crossing_that_is_none_is_refused_by_name(
    http: httpx.Client, fields: dict[str, Any], status: int, code: str, where: str | None
) -> None:
    floor = {"kind": "box", "name": "floor", "center_m": [1.0, 0.0, -0.1], "size_m": [4.0, 2.0, 0.2]}
    answer = cross(http, [floor], **fields)
    assert refusal_code(answer) == (status, code), answer.text
    if where is not None:
        assert where in {fault["where"] for fault in answer.json()["errors"]}


def test_a_surface_without_a_direction_is_named(http: httpx.Client) -> None:
    box = {"kind": "box", "name": "floor", "center_m": [0, 0, 0], "size_m": [4, 2, 1], "orientation_wxyz": [0, 0, 0, 0]}
    answer = cross(http, [box])
    assert refusal_code(answer) == (422, "scenario-invalid")
    assert answer.json()["errors"][0]["where"] == "terrain[0]"


def test_client_reads_a_terrain_and_composes_its_crossing(service: Served, tmp_path_factory: Any) -> None:
    file = tmp_path_factory.mktemp("terrain") / "stairs.ply"
    file.write_bytes(stairs(1000.0, "ply"))
    with Client(service.base_url) as client:
        read = client.read_terrain(file, "mm", "+z")
        assert heights_m(read)[-1] == pytest.approx(3 * RISE_M, abs=1e-5)
        task = client.cross_terrain(
            {
                "robot": "g1",
                "terrain": [one.model_dump(mode="json", exclude_none=True) for one in read.terrain],
                "start_m": [0.0, 0.0],
                "goal_m": [2.0, 0.0],
            }
        )
        assert len(task.start.contacts) == 2
        with pytest.raises(ProblemError, match="m wide") as refusal:
            client.read_terrain(file)
        assert refusal.value.code == "terrain-mesh-unreadable"
