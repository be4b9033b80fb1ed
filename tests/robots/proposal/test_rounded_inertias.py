"""Masses and moments of inertia that rounding, or another unit, changed."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from stridelab.errors import InvalidInput
from stridelab.robots.proposal.propose import Proposal, propose_card, rebuild_description
from support.robots.humanoid import Humanoid, archive


def proposal_of_text(urdf: str, folder: Path) -> Proposal:
    (folder / "upload").write_bytes(archive({"small.urdf": urdf}))
    assumed = rebuild_description(folder / "upload", "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed)


def with_inertia(name: str, mass_kg: float, moments_kg_m2: tuple[float, ...]) -> str:
    """The usual robot with the mass and the moments of inertia of one link replaced."""
    root = ET.fromstring(Humanoid().urdf())
    inertial = root.find(f"link[@name='{name}']/inertial")
    assert inertial is not None
    for element in (inertial.find("mass"), inertial.find("inertia")):
        assert element is not None
        values = (
            {"value": mass_kg}
            if element.tag == "mass"
            else dict(zip(("ixx", "iyy", "izz"), moments_kg_m2, strict=True))
        )
        element.attrib.update({key: repr(value) for key, value in values.items()})
    return ET.tostring(root, encoding="unicode")


@pytest.mark.parametrize(("mass_kg", "moment"), [(0.37, -6e-9), (0.0134, -7e-8)])
def test_a_moment_that_is_negative_by_rounding_is_that_of_a_sphere(
    mass_kg: float, moment: float, tmp_path: Path
) -> None:
    """As of descriptions that state moments with a few decimals."""
    text = with_inertia("left_elbow_link", mass_kg, (moment, 3e-7, 3e-7))
    proposal = proposal_of_text(text, tmp_path)
    assert "kg m2" in proposal.assumed["link left_elbow_link: inertia"]


@pytest.mark.parametrize(("mass_kg", "moment"), [(0.37, -2e-7), (0.001, -7e-8)])
def test_a_moment_that_no_rounding_explains_is_refused(mass_kg: float, moment: float, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="link left_elbow_link: its smallest principal moment"):
        proposal_of_text(with_inertia("left_elbow_link", mass_kg, (moment, 3e-7, 3e-7)), tmp_path)


@pytest.mark.parametrize(("mass_kg", "match"), [(-8.0, "must not be negative"), (0.0001, "masses must be in kg")])
def test_masses_that_no_robot_has_are_refused(mass_kg: float, match: str, tmp_path: Path) -> None:
    text = re.sub(r'mass value="[^"]*"', f'mass value="{mass_kg}"', Humanoid(arms=False).urdf())
    with pytest.raises(InvalidInput, match=match) as refusal:
        proposal_of_text(text, tmp_path)
    assert refusal.value.code == "robot-description-invalid"
