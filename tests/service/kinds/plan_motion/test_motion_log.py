"""``motion.mcap`` read back by the library's reader: every frame, joint, force and shape of the motion at its time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from stridelab.service.kinds.plan_motion.display_tracks import display_forces, display_frames, display_poses
from stridelab.service.kinds.plan_motion.motion_log import NEWTON_PER_M, WORLD, write_motion_log
from stridelab.wholebody.replay.log import TorquePeak
from stridelab.wholebody.replay.replay import Replay
from support.robots.plans import made_up_motion, talos

Messages = dict[str, list[tuple[float, Any]]]


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> Messages:
    """Times (s) and decoded messages of every topic."""
    folder = tmp_path_factory.mktemp("log")
    artifact = write_motion_log(folder, talos(), made_up_motion(), half_of_the_replay())
    assert [path.name for path in folder.iterdir()] == [artifact.name] == ["motion.mcap"]
    return read(folder / artifact.name)


def half_of_the_replay() -> Replay:
    """A replay in which the robot does as planned, until it falls half way."""
    motion = made_up_motion()
    half = len(motion.time_s) // 2
    samples = {
        "time_s": motion.time_s,
        "plan_time_s": motion.time_s,
        "q": motion.q,
        "v": motion.v,
        "com_m": motion.com_m,
    }
    forces_n = {name: forces[:half].sum(axis=1) for name, forces in motion.forces_n.items()}
    numbers = ("com_error_rms_m", "com_error_max_m", "foot_slip_max_m", "landing_error_max_m")
    return Replay(
        **{name: values[:half] for name, values in samples.items()},
        forces_n=forces_n,
        fall_time_s=float(motion.time_s[half]),
        hand_force_mean_n=None,
        hand_contact_share=None,
        torque_peak=TorquePeak(),
        real_time_factor=1.0,
        **dict.fromkeys(numbers, 0.0),
    )


def read(path: Path) -> Messages:
    found: Messages = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            assert schema.encoding == "protobuf"
            assert schema.name.startswith("foxglove.")
            assert schema.name == f"foxglove.{type(decoded).__name__}"
            found.setdefault(channel.topic, []).append((message.log_time / 1e9, decoded))
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == sum(map(len, found.values()))
    return found


def shown_samples() -> tuple[Any, np.ndarray, np.ndarray]:
    motion = made_up_motion()
    frames = display_frames(len(motion.time_s), motion.rate_hz)
    return motion, frames, motion.time_s[frames]


def test_every_frame_has_the_pose_of_every_link(messages: Messages) -> None:
    motion, frames, time_s = shown_samples()
    poses = display_poses(talos(), motion.q[frames])
    assert [t for t, _ in messages["/tf"]] == pytest.approx(time_s.tolist(), abs=1e-9)
    for k in (0, len(frames) // 2, len(frames) - 1):
        transforms = messages["/tf"][k][1].transforms
        assert len(transforms) == poses.shape[1]
        for one, pose in zip(transforms, poses[k], strict=True):
            assert one.parent_frame_id == WORLD
            place, turn = one.translation, one.rotation
            assert [place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z] == pytest.approx(pose.tolist())
            assert one.timestamp.ToNanoseconds() == round(float(time_s[k]) * 1e9)


def test_the_replay_has_frames_of_its_own_until_it_falls(messages: Messages) -> None:
    planned, replayed = messages["/tf"], messages["/replay/tf"]
    assert 0.4 * len(planned) < len(replayed) < 0.6 * len(planned)
    for (at_s, one), (other_s, other) in zip(planned, replayed, strict=False):
        assert at_s == other_s
        names = [transform.child_frame_id for transform in one.transforms]
        assert [transform.child_frame_id for transform in other.transforms] == [f"replay/{name}" for name in names]
    base, other = (topic[5][1].transforms[0].translation for topic in (planned, replayed))
    assert (other.x, other.y, other.z) == pytest.approx((base.x, base.y, base.z))


def test_the_joints_have_their_names_angles_rates_and_torques(messages: Messages) -> None:
    motion, frames, _ = shown_samples()
    last = messages["/joints"][-1][1].joints
    assert [joint.name for joint in last] == list(talos().joint_names)
    assert [joint.position for joint in last] == pytest.approx(motion.q[frames[-1], 7:].tolist())
    assert [joint.velocity for joint in last] == pytest.approx(motion.v[frames[-1], 6:].tolist())
    assert [joint.effort for joint in last] == pytest.approx(motion.tau_nm[frames[-1]].tolist())
    com = messages["/com"][-1][1].pose.position
    assert [com.x, com.y, com.z] == pytest.approx(motion.com_m[frames[-1]].tolist())


def test_arrows_point_along_the_forces_and_are_as_long(messages: Messages) -> None:
    motion, frames, _ = shown_samples()
    forces, arrows = display_forces(motion, frames), 0
    for k in (0, len(frames) // 2):
        entities = messages["/forces"][k][1].entities
        assert [entity.id for entity in entities] == list(motion.forces_n)
        for entity, row in zip(entities, forces[k], strict=True):
            size_n = float(np.linalg.norm(row[3:]))
            assert len(entity.arrows) == int(size_n > 1.0)
            for arrow in entity.arrows:
                turn, at = arrow.pose.orientation, arrow.pose.position
                along = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply([1.0, 0.0, 0.0])
                assert arrow.shaft_length * NEWTON_PER_M * along == pytest.approx(row[3:], abs=1e-6 * size_n)
                assert [at.x, at.y, at.z] == pytest.approx(row[:3].tolist())
                arrows += 1
    assert arrows > 1


def test_the_scene_holds_the_terrain_and_a_shape_in_the_frame_of_its_link(messages: Messages) -> None:
    ((at_s, update),) = messages["/scene"]
    ground, *links = update.entities
    assert (at_s, ground.id, ground.frame_id) == (0.0, "terrain", WORLD)
    boxes = made_up_motion().sequence.terrain.boxes
    assert [[one.size.x, one.size.y, one.size.z] for one in ground.cubes] == [box.size_m.tolist() for box in boxes]
    assert {entity.frame_id for entity in links} <= {one.child_frame_id for one in messages["/tf"][0][1].transforms}
    assert all(entity.frame_locked and entity.models[0].data[:4] == b"glTF" for entity in links)
    assert "base_link" in {entity.id for entity in links}
