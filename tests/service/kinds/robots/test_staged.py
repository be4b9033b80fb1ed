"""A robot of a user in the folder of a child: what a damaged disk left of its files is refused by name."""

import json
from pathlib import Path

import pytest

from stridelab.errors import UnreadableFile
from stridelab.service.filenames import BUNDLE_FILE, LEARNED_FILE, STAGED_ROBOT
from stridelab.service.kinds.robots.staged import pack_files, use_staged_robot

CARD = {"title": "Mine", "licence": "ours"}


def stage(folder: Path, damaged: str) -> None:
    """A staged robot, one of whose archives has a flipped byte in its content."""
    source = folder / "source"
    source.write_bytes(bytes(range(256)) * 40)
    for archive, member in ((BUNDLE_FILE, "robot.urdf"), (LEARNED_FILE, "uniform.npz")):
        pack_files({member: source}, folder / archive)
    content = bytearray((folder / damaged).read_bytes())
    content[60] ^= 0x10
    (folder / damaged).write_bytes(content)
    (folder / STAGED_ROBOT).write_text(json.dumps({"name": "mine", "card": CARD}), encoding="utf-8")


@pytest.mark.parametrize("damaged", [BUNDLE_FILE, LEARNED_FILE])
def test_a_damaged_stored_file_is_named(tmp_path: Path, damaged: str) -> None:
    stage(tmp_path, damaged)
    with pytest.raises(UnreadableFile) as refusal:
        use_staged_robot(tmp_path)
    assert refusal.value.code == "stored-file-damaged"
    assert [fault.where for fault in refusal.value.faults] == [damaged]
