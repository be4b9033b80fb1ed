"""A recording of the gait scene, read as viser's player reads it: markers, sticks and forces are those of the files."""

import base64
import re
from typing import Any

import httpx
import msgspec
import numpy as np
import pytest
import zstandard
from scipy.spatial.transform import Rotation

from stridelab_web.parquet import read_columns
from stridelab_web.scene.frames import ARROW_M_PER_N, HEAD_M
from stridelab_web.scene.recording_frames import build_frames
from stridelab_web.viewer.control import create_control
from stridelab_web.viewer.scene_builders import document_kinds
from stridelab_web.viewer.scene_limits import SceneLimits
from stridelab_web.viewer.scene_pool import ScenePool
from support.fakes.service import FakeService
from support.fakes.web_app import Caller, make_client

HOST = {"Host": "127.0.0.1:1"}


def read(file: bytes) -> dict[str, Any]:
    """What viser's player finds in a ``.viser`` file."""
    inner = zstandard.ZstdDecompressor().decompress(file[8:], max_output_size=int.from_bytes(file[:8], "little"))
    length = int.from_bytes(inner[:8], "little")
    reports: dict[str, Any] = msgspec.msgpack.decode(inner[8 : 8 + length])
    return reports


def states_at(told: dict[str, Any], time_s: float) -> dict[str, dict[str, Any]]:
    """Position, turn, scale and visibility of every node once all messages until ``time_s`` have been read."""
    result: dict[str, dict[str, Any]] = {}
    for at_s, message in told["messages"]:
        if at_s > time_s + 1e-9 or "name" not in message:
            continue
        state = result.setdefault(message["name"], {})
        for key in ("position", "wxyz", "visible"):
            if key in message:
                state[key] = message[key]
        state.update({k: v for k, v in message.get("updates", {}).items() if k == "scale"})
    return result


@pytest.fixture
def fake_with_estimate(fake: FakeService) -> tuple[FakeService, dict[str, str]]:
    recording = fake.add_recording()
    job = fake.add_job(state="succeeded", recording_id=recording.id)
    return fake, {"kind": "recording", "id": recording.id, "job_id": job.id}


def player(fake: FakeService, document: dict[str, str], form: str) -> httpx.Response:
    calls = Caller(
        create_control(ScenePool(document_kinds(fake.client(), lambda _: fake.client()), SceneLimits(8)), None)
    )
    return calls.request("POST", f"/players/{form}", json=document, headers=HOST)


def test_the_player_shows_what_the_page_shows(fake_with_estimate: tuple[FakeService, dict[str, str]]) -> None:
    fake, document = fake_with_estimate
    reports = read(player(fake, document, "viser").content)
    frames = build_frames(fake.recordings[document["id"]], read_columns(fake.tracks), read_columns(fake.com))
    lasts_s = float(frames.time_s[-1] - frames.time_s[0])
    assert reports["durationSeconds"] == pytest.approx(lasts_s, rel=0.02)
    half_s = reports["durationSeconds"] / 2
    row = frames.values[int(np.searchsorted(frames.time_s, frames.time_s[0] + half_s - 1e-6))].astype(float)
    # a frame lasts until the next one: the step that begins at or before the instant
    near = frames.values[np.abs(frames.time_s - frames.time_s[0] - half_s) < 0.05].astype(float)
    shown = states_at(reports, half_s)
    moved = 0
    for point in frames.points:
        if not np.isfinite(row[point.at : point.at + 3]).all():
            continue
        off_m = np.linalg.norm(near[:, point.at : point.at + 3] - np.array(shown[point.name]["position"]), axis=1)
        assert off_m.min() < 1e-6, point.name
        moved += 1
    assert moved > 5
    for stick in frames.sticks:
        start, end = (near[:, at : at + 3] for at in (stick.start, stick.end))
        if not np.isfinite(np.concatenate([start, end])).all() or not shown[stick.name]["visible"]:
            continue
        assert_points(shown[stick.name], start, end)
    for arrow in frames.arrows:
        state = shown[arrow.shaft]
        force = near[:, arrow.at + 3 : arrow.at + 6]
        if state.get("visible") and np.isfinite(force).all() and (np.linalg.norm(force, axis=1) > 200).all():
            origin = near[:, arrow.at : arrow.at + 3]
            shaft = force * (ARROW_M_PER_N - HEAD_M / np.linalg.norm(force, axis=1, keepdims=True))
            assert_points(state, origin, origin + shaft)
    assert not shown["/forces/total_shaft"]["visible"]


def assert_points(state: dict[str, Any], start: np.ndarray, end: np.ndarray) -> None:
    """A unit cylinder along z, turned and stretched, joins one of the pairs of points."""
    w, x, y, z = state["wxyz"]
    tip = np.array(state["position"]) + Rotation.from_quat([x, y, z, w]).apply([0.0, 0.0, state["scale"][2]])
    off_m = np.linalg.norm(start - np.array(state["position"]), axis=1) + np.linalg.norm(end - tip, axis=1)
    assert off_m.min() < 1e-5


def test_the_page_holds_the_player_and_the_same_recording(
    fake_with_estimate: tuple[FakeService, dict[str, str]],
) -> None:
    fake, document = fake_with_estimate
    page = player(fake, document, "html").text
    match = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', page)
    assert match is not None
    assert len(read(base64.b64decode(match[1]))["messages"]) > 100
    assert "https://" not in page.partition("</head>")[0]


def test_other_kinds_and_forms_have_none(fake: FakeService) -> None:
    scenario = {"kind": "scenario", "id": fake.add_scenario().id, "job_id": ""}
    assert player(fake, scenario, "viser").status_code == 404
    recording = {"kind": "recording", "id": fake.add_recording().id, "job_id": "-"}
    assert player(fake, recording, "gif").status_code == 404


def test_without_a_viewer_the_download_says_why(fake: FakeService) -> None:
    recording = fake.add_recording()
    answer = make_client(fake).get(f"/view/scene/recording/{recording.id}/-/motion.viser")
    assert answer.status_code == 503
    assert "without a viewer" in answer.text
