"""The parts that a plan shows while it is computed are those of its result."""

from pathlib import Path

import numpy as np
import pytest

from stridelab.robots.loader import load_robot
from stridelab.robots.visuals import link_names, link_poses
from stridelab.schemas.previews import PartialCertificate, PartialMotion, PartialPlan, PartialReplay
from stridelab.service.jobs.partial_results import CHUNK
from stridelab.service.kinds.partial_results import PARTIAL_FOLDER, PartialWriter, chunk_name
from support.robots.plans import run, short_walk


def test_the_parts_are_those_of_the_result(tmp_path: Path) -> None:
    """Frames of the last run of the body, the checks of the certificate, and frames of the replay, each sent once."""
    (tmp_path / PARTIAL_FOLDER).mkdir()
    plan = run(tmp_path, short_walk(), replay=True)
    files = sorted((tmp_path / PARTIAL_FOLDER).iterdir())
    assert [file.name for file in files] == [chunk_name(k + 1) for k in range(len(files))]
    chunks = [CHUNK.validate_json(file.read_bytes()) for file in files]
    robot = load_robot("talos")
    first = chunks[0]
    assert isinstance(first, PartialPlan)
    assert first.links == list(link_names(robot))
    assert first.phase_ends_s == pytest.approx(np.cumsum([phase.duration_s for phase in short_walk().phases]))

    def compare(frames: list[PartialMotion] | list[PartialReplay], arrays: dict[str, np.ndarray]) -> None:
        times_s = [t for one in frames for t in one.time_s]
        poses = [pose for one in frames for pose in one.poses]
        steps_s = np.diff(times_s)
        assert steps_s.min() > 0.03
        assert steps_s.max() < 0.045
        assert times_s[0] <= arrays["time_s"][0] + 1e-4
        assert arrays["time_s"][-1] - times_s[-1] < 0.041
        nearest = np.abs(arrays["time_s"][:, None] - np.array(times_s)).argmin(axis=0)
        expected = np.array([link_poses(robot, arrays["q"][k]) for k in nearest])
        np.testing.assert_allclose(np.array(poses), expected, atol=6e-5)

    motions = [chunk for chunk in chunks if isinstance(chunk, PartialMotion)]
    last = max(chunk.run for chunk in motions)
    assert last == len(plan.summary.agreement)
    compare([chunk for chunk in motions if chunk.run == last], plan.arrays())
    assert plan.summary.certificate is not None
    parts = [chunk for chunk in chunks if isinstance(chunk, PartialCertificate)]
    assert [check for part in parts for check in part.checks] == plan.summary.certificate.checks
    assert [part.passed for part in parts][-2:] == [None, plan.summary.certificate.passed]
    with np.load(tmp_path / "replay.npz") as arrays:
        compare([chunk for chunk in chunks if isinstance(chunk, PartialReplay)], dict(arrays))


def test_a_writer_without_its_folder_writes_nothing(tmp_path: Path) -> None:
    writer = PartialWriter(tmp_path)
    writer.write(PartialCertificate(checks=[], passed=True))
    assert not writer.is_open
    assert list(tmp_path.iterdir()) == []


def test_a_writer_ends_where_its_folder_is_gone(tmp_path: Path) -> None:
    (tmp_path / PARTIAL_FOLDER).mkdir()
    writer = PartialWriter(tmp_path)
    (tmp_path / PARTIAL_FOLDER).rmdir()
    writer.write(PartialCertificate(checks=[], passed=True))
    assert not writer.is_open
