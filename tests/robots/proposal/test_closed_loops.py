"""Closed loops of MJCF files: what only closes them is fixed, and what they move keeps its joints."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import pytest

from stridelab.robots.proposal.propose import propose_card, rebuild_description
from support.robots.humanoid import Humanoid, archive

ROD = """<body name="{side}_crank" pos="-0.03 0 -0.2"><joint name="{side}_crank" axis="0 1 0"/>
<geom type="box" size=".02 .01 .01" mass="0.2"/>
<body name="{side}_rod" pos="-0.02 0 0"><joint type="ball"/><geom type="box" size=".005 .005 .08" mass="0.1"/></body>
</body>"""


def test_cranks_and_rods_of_parallel_ankles_are_fixed(tmp_path: Path) -> None:
    """As of ankles that two motors in the shank turn through rods; the ankle's joints keep moving."""
    text = Humanoid().mjcf()
    loops = ""
    for side in ("left", "right"):
        at = text.index(f'<body name="{side}_ankle_pitch_link"')
        text = text[:at] + ROD.format(side=side) + text[at:]
        loops += f'<connect body1="{side}_ankle_roll_link" body2="{side}_rod" anchor="-0.05 0 0"/>'
    text = text.replace("</mujoco>", f"<equality>{loops}</equality></mujoco>")
    (tmp_path / "upload").write_bytes(archive({"small.xml": text}))
    assumed = rebuild_description(tmp_path / "upload", "small.zip", "small", tmp_path / "robots")
    proposal = propose_card("small", "small", tmp_path / "robots", assumed)
    assert {f"body {side}_{part}" for side in ("left", "right") for part in ("crank", "rod")} < assumed.keys()
    assert proposal.card.effectors["left_foot"].ankle == ("left_ankle_pitch", "left_ankle_roll")
    assert proposal.card.locked_joints == ()
    assert proposal.robot.mass_kg == pytest.approx(mujoco_mass_kg(Humanoid().mjcf()) + 2 * (0.2 + 0.1))


def test_a_loop_that_ends_at_its_own_beginning_keeps_what_moves_in_between(tmp_path: Path) -> None:
    """As of a waist that rods of the trunk turn against the pelvis, which carries all of it."""
    text = Humanoid().mjcf()
    end = text.index('<body name="left_shoulder_pitch_link"')
    text = text[:end] + ROD.format(side="waist") + text[end:]
    loop = '<equality><connect body1="pelvis" body2="waist_rod" anchor="-0.05 0 0"/></equality>'
    (tmp_path / "upload").write_bytes(archive({"small.xml": text.replace("</mujoco>", f"{loop}</mujoco>")}))
    changed = rebuild_description(tmp_path / "upload", "small.zip", "small", tmp_path / "robots")
    root = ET.parse(tmp_path / "robots" / "small" / "robot.urdf").getroot()
    kinds = {joint.attrib["name"]: joint.attrib["type"] for joint in root.iter("joint")}
    assert kinds["waist"] == "revolute"
    assert "waist_crank" not in kinds
    assert {"body waist_crank", "body waist_rod"} < changed.keys()


def mujoco_mass_kg(text: str) -> float:
    """Mass of all bodies of an MJCF file."""
    return float(mujoco.mj_getTotalmass(mujoco.MjModel.from_xml_string(text)))
