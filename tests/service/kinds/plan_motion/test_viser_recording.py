"""``motion.viser`` holds the scene once and every pose at its time; making it prints nothing and keeps no door open."""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil
import pytest
import viser
import zstandard

from stridelab.contacts.terrain import Terrain
from stridelab.robots.visuals import glb, link_meshes, link_names
from stridelab.service.filenames import LINKS_FILE
from stridelab.service.kinds.plan_motion import files
from stridelab.service.kinds.plan_motion.display_tracks import display_poses
from stridelab.service.kinds.plan_motion.files import write_motion
from stridelab.service.kinds.plan_motion.viser_recording import player_page, record_scene
from support.robots.plans import made_up_motion, one_step, talos

LINKS = ("base_link", "leg_left_6_link", "arm_right_7_link")


def read(recording: bytes) -> dict[str, Any]:
    """A ``.viser`` file: length, then zstd of (length of the messages, messages as msgpack, buffers)."""
    raw = zstandard.ZstdDecompressor().decompressobj().decompress(recording[8:])
    assert len(raw) == int.from_bytes(recording[:8], "little")
    length = int.from_bytes(raw[:8], "little")
    return dict(msgspec.msgpack.decode(raw[8 : 8 + length]))


@pytest.fixture(scope="module")
def recorded() -> tuple[dict[str, Any], np.ndarray]:
    robot, motion = talos(), made_up_motion()
    links = link_meshes(robot)
    chosen = [i for i, link in enumerate(links) if link.name in LINKS]
    poses = display_poses(robot, motion.q[::10])[:, chosen]
    return read(record_scene(one_step().terrain, {links[i].name: glb([links[i]]) for i in chosen}, poses, 25.0)), poses


def moves(document: dict[str, Any], kind: str, node: str, field: str) -> dict[float, list[float]]:
    """Messages of a node by time; the last one of an instant counts."""
    messages = [(t, m) for t, m in document["messages"] if m["type"] == kind and m["name"] == node]
    return {round(t, 6): m[field] for t, m in messages}


def test_every_link_has_its_pose_of_the_motion_at_every_instant(recorded) -> None:  # type: ignore[no-untyped-def]
    document, poses = recorded
    assert document["durationSeconds"] == pytest.approx(len(poses) / 25.0)
    for k, name in enumerate(LINKS):
        positions = moves(document, "SetPositionMessage", f"/robot/{name}", "position")
        turns = moves(document, "SetOrientationMessage", f"/robot/{name}", "wxyz")
        assert len(positions) == len(poses)
        for frame, (t, position) in enumerate(sorted(positions.items())):
            assert t == pytest.approx(frame / 25.0, abs=1e-6)
            assert position == pytest.approx(poses[frame, k, :3])
        assert turns[max(turns)] == pytest.approx(poses[round(max(turns) * 25.0), k, 3:])


def test_the_surroundings_stand_where_the_terrain_has_them(recorded) -> None:  # type: ignore[no-untyped-def]
    messages = [message for _, message in recorded[0]["messages"]]
    boxes = [m for m in messages if m["type"] == "BoxMessage"]
    assert [m["name"] for m in boxes] == ["/terrain/ground"]
    assert boxes[0]["props"]["dimensions"] == pytest.approx([4.0, 2.0, 0.1])
    rail = next(m for m in messages if m["type"] == "CylinderMessage")
    assert rail["props"]["height"] == pytest.approx(np.hypot(1.0, 0.5))
    w, x, y, z = moves(recorded[0], "SetOrientationMessage", "/terrain/rail", "wxyz")[0.0]
    along = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    assert along == pytest.approx(np.array([1.0, 0.0, 0.5]) / np.hypot(1.0, 0.5))
    meshes = [m["name"] for m in messages if m["type"] == "GlbMessage"]
    assert sorted(meshes) == sorted(f"/robot/{name}" for name in LINKS)


def test_nothing_is_printed_and_nothing_listens_afterwards(capfd: pytest.CaptureFixture[str]) -> None:
    before = {c.laddr for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN}
    link = link_meshes(talos())[0]
    record_scene(
        one_step().terrain, {link.name: glb([link])}, np.tile([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0], (3, 1, 1)), 25.0
    )
    assert {c.laddr for c in psutil.Process().net_connections("tcp") if c.status == psutil.CONN_LISTEN} == before
    assert capfd.readouterr() == ("", "")


def test_the_stored_meshes_of_a_service_are_not_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot, motion, recorded = talos(), made_up_motion(), []

    def keep_links(_terrain: Terrain, links: dict[str, bytes], *_: object) -> bytes:
        recorded.append(links)
        return b""

    monkeypatch.setattr(files, "record_scene", keep_links)
    write_motion(tmp_path, robot, motion)
    (tmp_path / LINKS_FILE).write_bytes(glb(link_meshes(robot))[:-1])  # damaged
    write_motion(tmp_path, robot, motion)
    (tmp_path / LINKS_FILE).write_bytes(glb(link_meshes(robot)))
    monkeypatch.setattr(files, "link_meshes", lambda _robot: pytest.fail("made anew"))
    write_motion(tmp_path, robot, motion)
    assert recorded[0] == recorded[1] == recorded[2]
    assert tuple(recorded[2]) == link_names(robot)


def test_the_page_is_the_player_that_viser_would_have_made() -> None:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        serializer = server.get_scene_serializer()
        recording = serializer.serialize()
        serializer.serialize = lambda: recording  # type: ignore[method-assign]
        expected = serializer.as_html()
    finally:
        server.stop()
    assert player_page(recording) == expected
