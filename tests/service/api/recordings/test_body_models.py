"""Uploads of body models with joint angles, and of MVNX files, through the sandboxed parser."""

import io
import zipfile

import httpx
import pytest

from support.recordings.body_model_files import rocking_members
from support.recordings.export_files import mvnx_text
from support.service.web_server import Served, fault_places, refusal_code, upload


def zipped(members: dict[str, str]) -> bytes:
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w") as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return raw.getvalue()


def test_a_model_with_joint_angles_and_forces_is_a_recording(http: httpx.Client) -> None:
    answer = upload(http, zipped(rocking_members(2.0)), "rocking.zip")
    assert answer.status_code == 201, answer.text
    body = answer.json()
    assert (body["marker_set"], body["subject"]["mass_kg"], len(body["plates"])) == ("opensim-bodies", 70.0, 1)
    assert body["mass_from_force_kg"] == pytest.approx(70.0, rel=0.02)
    assert body["windows_s"]
    assert "body-model" in {remark["code"] for remark in body["warnings"]}


def test_an_mvnx_file_is_a_recording_without_the_name_in_it(http: httpx.Client) -> None:
    answer = upload(http, mvnx_text(points=False).encode(), "walk.mvnx")
    assert answer.status_code == 201, answer.text
    assert (answer.json()["marker_set"], answer.json()["plates"]) == ("xsens-segments", [])
    assert "Anna" not in answer.text


def test_a_model_with_entities_is_refused_by_its_name(http: httpx.Client, service: Served) -> None:
    before = service.stored_files()
    members = rocking_members(0.5)
    entity = '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'
    members["subject.osim"] = members["subject.osim"].replace("<OpenSimDocument", f"{entity}<OpenSimDocument", 1)
    answer = upload(http, zipped(members), "rocking.zip")
    assert refusal_code(answer) == (422, "osim-broken")
    assert fault_places(answer) == ["subject.osim"]
    assert service.stored_files() == before
