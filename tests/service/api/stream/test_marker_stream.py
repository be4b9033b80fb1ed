"""The stream of markers over a real websocket: answers, refusals, bridged gaps, and viewers."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from stridelab.service.api.stream.watching import MAX_WATCHING
from support.command_line import SAMPLE
from support.service.database import TestDatabases
from support.service.processes import wait_until
from support.service.streams import (
    PATH,
    frame,
    header,
    marker_socket,
    receive_close,
    receive_reply,
    sample,
    send_frames,
    send_header,
)
from support.service.web_server import Served, served

TOKEN = "a-secret-of-the-lab"


@pytest.fixture(scope="module")
def guarded(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service with a token and room for one stream."""
    limits = {"stream_limit": 1, "stream_idle_s": 1.5, "api_token": TOKEN}
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data"), **limits) as running:
        yield running


def test_a_walk_is_answered_frame_by_frame(service: Served) -> None:
    with marker_socket(service) as socket:
        ready = send_header(socket)["ready"]
        replies = send_frames(socket, [frame(k) for k in range(60)])
    assert ready["marker_set"] == "isb-head"
    assert ready["landmarks"]["l_asis"] == "L_IAS"
    assert ready["force_used"]
    assert [one["t_s"] for one in replies] == pytest.approx(sample().time_s[:60])
    last = replies[-1]
    assert last["speed_m_s"] == pytest.approx(1.2, abs=0.15)
    assert last["bridged"]["geometry"] == "measured"
    omega = np.sqrt(9.81 / np.mean([one["height_m"] for one in replies]))
    expected = np.array(last["com_m"])[:2] + np.array(last["velocity_m_s"])[:2] / omega
    assert last["xcom_m"][:2] == pytest.approx(expected, abs=2e-3)
    assert {one["contact"]["left"] for one in replies} | {one["contact"]["right"] for one in replies} == {True, False}
    assert all(one["margin_m"] for one in replies)


def test_the_answer_to_the_header_says_what_is_missing_and_what_it_costs(service: Served) -> None:
    arms = [label for label in sample().markers_m if label[2:] not in ("HLE", "HME", "RSP", "UHE", "HM2", "HM5")]
    with marker_socket(service) as socket:
        ready = send_header(socket, labels=[*arms, "WAND"], person={})["ready"]
    assert "WAND" in ready["unused"]
    codes = {remark["code"]: remark["message"] for remark in ready["remarks"]}
    assert "costs about" in codes["arms-missing"]
    assert "mass-not-stated" in codes
    assert not ready["force_used"]


def test_a_marker_set_by_name_states_the_order_of_the_markers(service: Served) -> None:
    with marker_socket(service) as socket:
        ready = send_header(socket, labels=None, marker_set="isb-head", plates=[])["ready"]
        by_form = {label.replace("_", "").lower(): label for label in sample().markers_m}
        tracks = [sample().markers_m.get(by_form.get(label, "")) for label in ready["labels"]]
        markers = [None if track is None else track[0].tolist() for track in tracks]
        (reply,) = send_frames(socket, [{"t_s": 0.0, "markers": markers}])
    assert reply["com_m"][2] == pytest.approx(0.9, abs=0.05)


@pytest.mark.parametrize(
    ("fields", "code", "status", "where"),
    [
        ({"labels": ["A", "B", "C"]}, "unknown-marker-set", 422, "labels found"),
        ({"labels": None}, "invalid-request", 422, None),
        ({"labels": ["A", "A"]}, "invalid-request", 422, None),
        ({"marker_set": "nowhere"}, "marker-set-unknown", 422, "marker_set"),
        ({"marker_map": {"tail": "L_IAS"}}, "marker-map-invalid", 422, "marker_map.tail"),
        ({"rate_hz": 1000.0}, "rate-too-high", 422, "rate_hz"),
        ({"rate_hz": 0.0}, "invalid-request", 422, "rate_hz"),
        ({"units": "inch"}, "invalid-request", 422, "units"),
        ({"person": {"mass_kg": -5}}, "invalid-request", 422, "person.mass_kg"),
        ({"plates": [{"corners": [[0, 0, 0]]}]}, "invalid-request", 422, "plates.0.corners"),
        ({"colour": 1}, "invalid-request", 422, "colour"),
    ],
)
def test_a_header_that_cannot_be_used_is_refused(
    service: Served, fields: dict[str, Any], code: str, status: int, where: str | None
) -> None:
    with marker_socket(service) as socket:
        problem = send_header(socket, **fields)["problem"]
        assert (problem["code"], problem["status"]) == (code, status)
        assert len(problem["detail"]) > 20
        places = [fault["where"] for fault in problem["errors"]]
        assert where is None or any(place.startswith(where) for place in places), places
        assert receive_close(socket) == (4000 + status, code)


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("garbage", "invalid-frame"),
        (b"\x00\x01", "wrong-format"),
        (json.dumps({"t_s": 0.0}), "invalid-frame"),
        (json.dumps({"t_s": 0.0, "markers": [[1, 2, 3]]}), "invalid-frame"),
        (json.dumps({**frame(0), "plates": [None]}), "invalid-frame"),
        (json.dumps({**frame(0), "t_s": float("nan")}), "invalid-frame"),
        (json.dumps({**frame(0), "t_s": 1e300}), "invalid-frame"),
    ],
    ids=["garbage", "bytes", "no markers", "too few markers", "too few plates", "time is nan", "time is huge"],
)
def test_a_message_that_is_no_frame_ends_the_stream(service: Served, message: str | bytes, code: str) -> None:
    with marker_socket(service) as socket:
        assert "ready" in send_header(socket)
        socket.send(message)
        assert receive_reply(socket)["problem"]["code"] == code
        assert receive_close(socket) == (4422, code)


def test_missing_data_of_a_frame_are_bridged_and_reported(service: Served) -> None:
    """Lost frames, hidden markers, NaN, a plate that is late or says NaN, and time that runs back."""
    labels = list(sample().markers_m)
    hidden = frame(31)
    hidden["markers"][labels.index("L_FME")] = [float("nan"), 0.0, 0.0]
    hidden["markers"][labels.index("L_FM1")] = None
    hidden["markers"][labels.index("CV7")] = [0, 0, 0]
    wild = frame(32, plates=[{"force_n": [float("nan"), 0, 0], "cop": None}, None])
    frames = [*(frame(k) for k in range(20)), frame(30), hidden, wild, frame(25), frame(33, plates=None), frame(34)]
    with marker_socket(service) as socket:
        send_header(socket)
        replies = send_frames(socket, frames)
    lost, masked, broken, late, unread, whole = replies[-6:]
    assert lost["bridged"]["frames_lost"] == 10
    assert set(masked["bridged"]["markers_hidden"]) == {"l_knee_medial", "l_mt1", "c7"}
    assert late["com_m"] is None
    assert (late["reason"], late["margin_m"], late["margin_reason"]) == ("frame-late", None, "frame-late")
    for one in (lost, masked, broken, unread, whole):
        assert one["com_m"] is not None
        assert one["margin_m"] is not None
    truth = np.array([one["com_m"] for one in (lost, masked, broken, unread, whole)])
    assert np.abs(np.diff(truth, axis=0)).max() < 0.03, "no jump"


def test_units_and_axes_of_the_laboratory(service: Served) -> None:
    """Millimetres and y up: the same person, answered in metres in the axes of the laboratory."""
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z up -> y up

    def turned(points: Any, scale: float = 1000.0) -> Any:
        return (np.array(points) @ R.T * scale).tolist()

    plain = [frame(k, plates=None) for k in range(5)]
    in_lab = [{"t_s": one["t_s"], "markers": turned(one["markers"])} for one in plain]
    with marker_socket(service) as socket:
        send_header(socket, plates=[])
        last_reply = send_frames(socket, [{k: v for k, v in one.items() if k != "plates"} for one in plain])[-1]
    with marker_socket(service) as socket:
        send_header(socket, units="mm", up_axis="+y", plates=[])
        in_lab_units = send_frames(socket, in_lab)[-1]
    for name in ("com_m", "velocity_m_s", "xcom_m"):
        assert in_lab_units[name] == pytest.approx(turned(last_reply[name], 1.0), abs=1e-6)
    assert in_lab_units["margin_m"] == pytest.approx(last_reply["margin_m"], abs=1e-6)
    assert in_lab_units["com_sd_m"][1] == pytest.approx(last_reply["com_sd_m"][2], abs=1e-9)


def test_a_body_out_of_view_has_no_estimate_until_it_returns(service: Served) -> None:
    nothing = [frame(k, markers=[None] * len(sample().markers_m), plates=None) for k in range(50, 200)]
    with marker_socket(service) as socket:
        send_header(socket)
        replies = send_frames(socket, [*(frame(k) for k in range(50)), *nothing, *(frame(k) for k in range(200, 230))])
    out_of_view, last_reply = replies[60:200], replies[-1]
    assert all(one["com_m"] is None and one["xcom_m"] is None and one["margin_m"] is None for one in out_of_view)
    assert {one["reason"] for one in out_of_view} <= {
        "pelvis-markers-missing",
        "markers-hidden",
        "markers-never-together",
    }
    assert last_reply["com_m"] is not None
    assert last_reply["reason"] is None


def test_viewers_receive_the_stream_and_its_end(service: Served) -> None:
    with marker_socket(service) as socket:
        stream_id = send_header(socket, title="Lane 3")["ready"]["stream_id"]
        with service.http() as http:
            listed = http.get("/api/v1/stream/markers").json()["items"]
        assert [(one["stream_id"], one["title"], one["marker_set"]) for one in listed] == [
            (stream_id, "Lane 3", "isb-head")
        ]
        with (
            marker_socket(service, f"{PATH}/{stream_id}") as first,
            marker_socket(service, f"{PATH}/{stream_id}") as second,
        ):
            wait_until(lambda: service.parts.live.describe_all()[0].n_watching == 2, 10, "both watch")
            (reply,) = send_frames(socket, [frame(0)])
            pictures = [receive_reply(watcher) for watcher in (first, second)]
            assert [picture["answer"] for picture in pictures] == [reply, reply]
            assert pictures[0]["com"] == pytest.approx(reply["com_m"], abs=1e-3)
            assert len(pictures[0]["markers"]) == len(sample().markers_m)
            assert {"l_knee", "r_hip", "vertex"} <= set(pictures[0]["joints"])
            assert len(pictures[0]["base"]) >= 4
            send_frames(socket, [frame(k) for k in range(1, 50)])
            assert receive_reply(first)["answer"]["t_s"] > 0.0, "who does not read misses pictures and delays nothing"
            socket.close()
            last = [receive_reply(second) for _ in range(1)]
            assert last[0]["answer"]["t_s"] > 0.0
    wait_until(lambda: not service.parts.live.describe_all(), 10, "the stream is no longer listed")


def test_an_ended_stream_closes_its_viewers(service: Served) -> None:
    with marker_socket(service) as socket:
        stream_id = send_header(socket)["ready"]["stream_id"]
        with marker_socket(service, f"{PATH}/{stream_id}") as watcher:
            wait_until(lambda: service.parts.live.describe_all()[0].n_watching == 1, 10, "it watches")
            socket.close()
            assert receive_close(watcher) == (1000, "stream-ended")
    with marker_socket(service, f"{PATH}/{stream_id}") as late:
        assert receive_reply(late)["problem"]["code"] == "stream-not-found"
        assert receive_close(late) == (4404, "stream-not-found")


def test_the_number_of_viewers_of_a_stream_is_limited(service: Served) -> None:
    with marker_socket(service) as socket:
        stream_id = send_header(socket)["ready"]["stream_id"]
        channel = service.parts.live.require_channel(stream_id)
        places = [channel.watch() for _ in range(MAX_WATCHING)]
        for place in places:
            place.__enter__()
        with marker_socket(service, f"{PATH}/{stream_id}") as one_more:
            assert receive_reply(one_more)["problem"]["code"] == "too-many-watching"
            assert receive_close(one_more) == (4429, "too-many-watching")


def test_limits_login_and_origin_are_those_of_every_stream(guarded: Served, service: Served) -> None:
    login = {"Authorization": f"Bearer {TOKEN}"}
    foreign = {"Origin": "http://evil.example"}
    for running, headers in ((guarded, {}), (guarded, {"Authorization": "Bearer wrong"}), (service, foreign)):
        for path in (PATH, f"{PATH}/0123"):
            with pytest.raises(InvalidStatus) as refused, marker_socket(running, path, **headers):
                pass
            assert refused.value.response.status_code == 403
    with marker_socket(guarded, **login) as socket:
        assert "ready" in send_header(socket)
        with marker_socket(guarded, **login) as second:
            assert receive_reply(second)["problem"]["code"] == "too-many-streams"
        assert receive_reply(socket)["problem"]["code"] == "stream-idle"
        assert receive_close(socket) == (4408, "stream-idle")
    wait_until(lambda: guarded.parts.streams.n_open == 0, 10, "the place is free again")


def test_a_reading_token_may_list_and_not_stream(guarded: Served) -> None:
    admin = {"Authorization": f"Bearer {TOKEN}"}
    with guarded.http() as http:
        token = http.post("/api/v1/tokens", json={"name": "reader", "scope": "read"}, headers=admin).json()
        reader = {"Authorization": f"Bearer {token['secret']}"}
        assert http.get("/api/v1/stream/markers", headers=reader).status_code == 200
    with pytest.raises(InvalidStatus) as refused, marker_socket(guarded, **reader):
        pass
    assert refused.value.response.status_code == 403


def test_a_header_in_the_wrong_form_is_refused(service: Served) -> None:
    for first, code in ((b"\x01", "configuration-first"), ("{", "not-json"), (" " * 300_000, "message-too-large")):
        with marker_socket(service) as socket:
            socket.send(first)
            assert receive_reply(socket)["problem"]["code"] == code
    assert header()["labels"]


def test_a_static_pose_gives_the_widths_that_the_walk_does_not_show(service: Served) -> None:
    """Inner knees and ankles are marked in the pose only, sent along or stored as a recording."""
    inner = {"L_FME", "R_FME", "L_TAM", "R_TAM"}
    labels = [label for label in sample().markers_m if label not in inner]
    pose = {label: track[0].tolist() for label, track in sample().markers_m.items()}
    with service.http() as http, (SAMPLE / "recording.c3d").open("rb") as file:
        stored = http.post("/api/v1/recordings", files={"file": ("pose.c3d", file)}).json()["id"]
    tracks = []
    for fields in ({}, {"labels": labels}, {"labels": labels, "static_pose": pose},
                   {"labels": labels, "static_recording_id": stored}):  # fmt: skip
        with marker_socket(service) as socket:
            send_header(socket, plates=[], **fields)
            used = fields.get("labels", list(sample().markers_m))
            markers = [sample().markers_m[label][0].tolist() for label in used]
            tracks.append(send_frames(socket, [{"t_s": 0.0, "markers": markers}])[0]["com_m"])
    whole, without, with_static, reused = np.array(tracks)
    assert np.abs(with_static - whole).max() < 1e-3
    assert np.abs(reused - whole).max() < 1e-3
    assert np.abs(without - whole).max() > 2.0 * np.abs(with_static - whole).max()
    with marker_socket(service) as socket:
        assert send_header(socket, static_recording_id="0" * 32)["problem"]["code"] == "recording-not-found"
        assert receive_close(socket) == (4404, "recording-not-found")
