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


@pytest.mark.parametrize("factor", [1.0, 30.0], ids=["light", "heavier than the foot"])
@pytest.mark.parametrize("joint", ["ball", "hinge"])
def test_cranks_and_rods_of_parallel_ankles_are_fixed(factor: float, joint: str, tmp_path: Path) -> None:
    """As of ankles that two motors in the shank turn through rods; the ankle's joints keep moving."""
    text = Humanoid().mjcf()
    loops = ""
    rod = ROD.replace('mass="0.2"', f'mass="{0.2 * factor}"').replace('mass="0.1"', f'mass="{0.1 * factor}"')
    for side in ("left", "right"):
        at = text.index(f'<body name="{side}_ankle_pitch_link"')
        text = text[:at] + rod.replace("ball", joint).format(side=side) + text[at:]
        loops += f'<connect body1="{side}_ankle_roll_link" body2="{side}_rod" anchor="-0.05 0 0"/>'
    motors = "".join(f'<motor joint="{side}_ankle_pitch"/>' for side in ("left", "right"))
    text = text.replace("</mujoco>", f"<equality>{loops}</equality><actuator>{motors}</actuator></mujoco>", 1)
    (tmp_path / "upload").write_bytes(archive({"small.xml": text}))
    assumed = rebuild_description(tmp_path / "upload", "small.zip", "small", tmp_path / "robots")
    proposal = propose_card("small", "small", tmp_path / "robots", assumed)
    assert {f"body {side}_{part}" for side in ("left", "right") for part in ("crank", "rod")} < assumed.keys()
    assert proposal.card.effectors["left_foot"].ankle == ("left_ankle_pitch", "left_ankle_roll")
    assert proposal.card.locked_joints == ()
    assert proposal.robot.mass_kg == pytest.approx(mujoco_mass_kg(Humanoid().mjcf()) + 2 * factor * (0.2 + 0.1))


def test_a_rod_on_a_ball_that_is_heavier_than_the_spring_it_holds_is_fixed(tmp_path: Path) -> None:
    """As of legs whose thigh carries a rod to a spring at the heel; the leg in between keeps its joints."""
    text = Humanoid().mjcf()
    rod = "<body name='{side}_rod' pos='-0.03 0 0'><joint type='ball'/><geom size='.005' mass='0.3'/></body>"
    spring = "<body name='{side}_spring' pos='-0.03 0 -0.2'><joint axis='0 1 0'/><geom size='.01' mass='0.1'/></body>"
    loops = ""
    for side in ("left", "right"):
        for child, part in (("knee_link", rod), ("ankle_pitch_link", spring)):
            at = text.index(f'<body name="{side}_{child}"')
            text = text[:at] + part.format(side=side) + text[at:]
        loops += f'<connect body1="{side}_rod" body2="{side}_spring" anchor="0 0 -0.3"/>'
    (tmp_path / "upload").write_bytes(
        archive({"small.xml": text.replace("</mujoco>", f"<equality>{loops}</equality></mujoco>")})
    )
    changed = rebuild_description(tmp_path / "upload", "small.zip", "small", tmp_path / "robots")
    kinds = {
        joint.attrib["name"]: joint.attrib["type"]
        for joint in ET.parse(tmp_path / "robots/small/robot.urdf").iter("joint")
    }
    assert {"body left_rod", "body right_rod"} < changed.keys()
    assert {kinds[f"left_{name}"] for name in ("knee", "ankle_pitch", "ankle_roll")} == {"revolute"}


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
