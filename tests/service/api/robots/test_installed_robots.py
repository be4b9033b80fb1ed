"""Robots of installed packages over HTTP: listed, added by name, and refused with the nearest name."""

import httpx
import pytest

from support.robots.humanoid import Humanoid, archive
from support.service.web_server import refusal_code

ROBOTS = "/api/v1/robots"


def send_form(http: httpx.Client, **fields: str) -> httpx.Response:
    parts = {name: (None, value) for name, value in fields.items()}
    return http.post(ROBOTS, files=parts, timeout=300.0)


def test_a_robot_of_an_installed_package_is_added_by_its_name(http: httpx.Client) -> None:
    listed = {one["package"]: one for one in http.get(f"{ROBOTS}/packages", timeout=120.0).json()["items"]}
    legs = "alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf"
    assert legs in listed["example-robot-data"]["descriptions"]
    answer = send_form(http, name="legs", package="example-robot-data", description=legs)
    assert answer.status_code == 201, answer.text
    own = answer.json()
    assert own["card"]["title"] == own["filename"].removesuffix(".zip")
    assert own["filename"].startswith("alexander_v1.lowerBodyOnly of example-robot-data 5.")
    assert own["card"]["effectors"].keys() == {"left_foot", "right_foot"}
    assert http.get(f"{ROBOTS}/legs/links", timeout=60.0).content.startswith(b"glTF")
    assert http.delete(f"{ROBOTS}/legs").status_code == 204


@pytest.mark.parametrize(
    ("fields", "code", "words"),
    [
        ({"package": "example-robot-dat"}, "robot-package-unknown", "the nearest is example-robot-data"),
        ({"package": "../../etc"}, "robot-package-unknown", "the nearest is"),
        (
            {"package": "example-robot-data", "description": "/etc/passwd"},
            "robot-description-missing",
            "no description of a robot whose path ends with '/etc/passwd'",
        ),
        ({"package": "example-robot-data"}, "robot-several-descriptions", "choose one"),
        ({"package": "example-robot-data", "description": "go2"}, "robot-not-humanoid", ""),
        ({}, "file-missing", "The form has no field 'file'"),
    ],
    ids=["nearest", "path", "description", "several", "quadruped", "neither"],
)
def test_a_name_that_is_not_installed_is_refused(
    http: httpx.Client, fields: dict[str, str], code: str, words: str
) -> None:
    refused = send_form(http, name="legs", **fields)
    assert refusal_code(refused) == (422, code)
    problem = refused.json()
    assert words in problem["detail"]
    assert http.get(f"{ROBOTS}/legs/card").status_code == 404


def test_a_form_has_a_file_or_a_package(http: httpx.Client) -> None:
    file = {"file": ("small.zip", archive({"small.urdf": Humanoid().urdf()}))}
    both = http.post(ROBOTS, files=file, data={"name": "other", "package": "example-robot-data"})
    assert refusal_code(both) == (422, "invalid-request")
    reserved = http.post(ROBOTS, files=file, data={"name": "packages"})
    assert refusal_code(reserved) == (409, "robot-name-taken")
