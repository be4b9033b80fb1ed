"""Meshes of several materials, inside out, or beside the mass of their link."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh

from stridelab.robots.proposal.propose import rebuild_description
from support.robots.humanoid import Humanoid, archive

HALF_M = np.array([0.05, 0.03, 0.02])
CORNERS_M = np.array([[x, y, z] for z in (-1, 1) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]) * HALF_M
SIDES = ((3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
"""Corners of the sides, counterclockwise seen from outside; the last one is of another material."""
BLUE, GREEN = "0.25 0.5 0.75 1", "0.2 0.6 0.2 1"


def collada(nodes: str, colour: str = f"<color>{BLUE}</color>") -> str:
    """A box whose last side is green, in the scene of ``nodes``."""
    effects = "".join(
        f'<effect id="{name}-effect"><profile_COMMON><technique sid="common"><lambert><diffuse>{shown}</diffuse>'
        "</lambert></technique></profile_COMMON></effect>"
        for name, shown in (("blue", colour), ("green", f"<color>{GREEN}</color>"))
    )
    materials = "".join(
        f'<material id="{name}"><instance_effect url="#{name}-effect"/></material>' for name in ("blue", "green")
    )
    lists = "".join(
        f'<polylist material="{name}" count="{len(sides)}"><input semantic="VERTEX" source="#vertices" offset="0"/>'
        f"<vcount>{'4 ' * len(sides)}</vcount><p>{' '.join(str(k) for side in sides for k in side)}</p></polylist>"
        for name, sides in (("blue", SIDES[:5]), ("green", SIDES[5:]))
    )
    places = " ".join(str(value) for value in CORNERS_M.ravel())
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/>'
        f"<up_axis>Z_UP</up_axis></asset><library_effects>{effects}</library_effects>"
        f"<library_materials>{materials}</library_materials><library_geometries>"
        f'<geometry id="box"><mesh><source id="places"><float_array id="values" count="24">{places}</float_array>'
        '<technique_common><accessor source="#values" count="8" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        f'<vertices id="vertices"><input semantic="POSITION" source="#places"/></vertices>{lists}</mesh></geometry>'
        f'</library_geometries><library_visual_scenes><visual_scene id="scene">{nodes}</visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#scene"/></scene></COLLADA>'
    )


def node(name: str, ahead_m: float, below: str = "") -> str:
    bound = "".join(f'<instance_material symbol="{one}" target="#{one}"/>' for one in ("blue", "green"))
    return (
        f'<node id="{name}"><matrix>1 0 0 {ahead_m} 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#box">'
        f"<bind_material><technique_common>{bound}</technique_common></bind_material></instance_geometry>{below}</node>"
    )


def drawn(
    content: str, name: str, folder: Path, scale: str = "1 1 1"
) -> tuple[trimesh.Trimesh, ET.Element, dict[str, str]]:
    """The pelvis as it is drawn: its rebuilt mesh, its colour, and what was assumed."""
    root = ET.fromstring(Humanoid().urdf())
    pelvis = root.find("link[@name='pelvis']")
    assert pelvis is not None
    visual = ET.SubElement(pelvis, "visual")
    ET.SubElement(ET.SubElement(visual, "geometry"), "mesh", filename=f"package://small/{name}", scale=scale)
    ET.SubElement(ET.SubElement(visual, "material", name="black"), "color", rgba="0 0 0 0.5")
    upload = folder / "upload"
    upload.write_bytes(archive({"small/small.urdf": ET.tostring(root, encoding="unicode"), f"small/{name}": content}))
    assumed = rebuild_description(upload, "small.zip", "small", folder / "robots")
    *_, shown = ET.parse(folder / "robots/small/robot.urdf").getroot().findall("link[@name='pelvis']/visual")
    mesh, color = shown.find("geometry/mesh"), shown.find("material/color")
    assert mesh is not None
    assert color is not None
    file = folder / "robots" / mesh.attrib["filename"].removeprefix("package://")
    return trimesh.load_mesh(file), color, assumed


@pytest.mark.parametrize(
    ("nodes", "boxes"),
    [
        (node("one", 0.0), 1),
        (node("one", 0.0) + node("two", 0.3), 2),
        (node("one", 0.0, node("below", 0.3) + node("beside", 0.6)), 3),
    ],
    ids=["one", "two nodes", "nodes below a node"],
)
def test_triangles_of_every_material_and_node_are_those_of_the_file(nodes: str, boxes: int, tmp_path: Path) -> None:
    mesh, _, _ = drawn(collada(nodes), "box.dae", tmp_path)
    assert len(mesh.faces) == 12 * boxes
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(boxes * 8.0 * HALF_M.prod(), rel=1e-5)
    low_m, high_m = mesh.bounds
    assert high_m - low_m == pytest.approx(2.0 * HALF_M + (0.3 * (boxes - 1), 0.0, 0.0), abs=1e-6)


def test_a_file_of_several_materials_that_is_no_collada(tmp_path: Path) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS_M]
    for k, side in enumerate(SIDES):
        lines += [f"usemtl m{k // 5}", "f " + " ".join(str(corner + 1) for corner in side)]
    mesh, color, assumed = drawn("\n".join(lines) + "\n", "box.obj", tmp_path)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(8.0 * HALF_M.prod(), rel=1e-5)
    assert [float(value) for value in color.attrib["rgba"].split()] == [0.0, 0.0, 0.0, 0.5]
    assert "colours" not in assumed


def test_the_colour_of_most_of_a_mesh_replaces_that_of_the_description(tmp_path: Path) -> None:
    _, color, assumed = drawn(collada(node("one", 0.0)), "box.dae", tmp_path)
    assert [float(value) for value in color.attrib["rgba"].split()] == [0.25, 0.5, 0.75, 0.5]
    assert "colours" in assumed


def test_a_texture_is_no_colour(tmp_path: Path) -> None:
    _, color, _ = drawn(collada(node("one", 0.0), '<texture texture="t" texcoord="u"/>'), "box.dae", tmp_path)
    assert [float(value) for value in color.attrib["rgba"].split()] == [0.2, 0.6, 0.2, 0.5]


@pytest.mark.parametrize(
    ("unit", "scale", "stated"),
    [("0.01", "1 1 1", 0.01), ("0.01", "0.5 0.5 0.5", None), ("nan", "1 1 1", None), ("-1", "1 1 1", None)],
)
def test_the_unit_of_a_file_counts_without_a_scale(unit: str, scale: str, stated: float | None, tmp_path: Path) -> None:
    """Some programs ignore it, and descriptions written for them scale their meshes themselves."""
    content = collada(node("one", 0.0)).replace('<unit meter="1"/>', f'<unit name="centimeter" meter="{unit}"/>')
    mesh, _, assumed = drawn(content, "box.dae", tmp_path, scale)
    factor = stated or float(scale.split()[0])
    assert mesh.extents == pytest.approx(2.0 * HALF_M * factor, rel=1e-5)
    how = "in the unit of 0.01 m that its file states, as in RViz"
    assert assumed.get("mesh package://small/box.dae") == (how if stated else None)


def test_a_node_that_a_file_repeats_is_drawn_as_often(tmp_path: Path) -> None:
    """The whole file is drawn, since its parts are fewer."""
    content = collada(node("two", 0.3, '<instance_node url="#one"/>'))
    content = content.replace(
        "<library_visual_scenes>", f"<library_nodes>{node('one', 0.6)}</library_nodes><library_visual_scenes>"
    )
    mesh, _, _ = drawn(content, "box.dae", tmp_path)
    assert mesh.extents == pytest.approx(2.0 * HALF_M + (0.6, 0.0, 0.0), abs=1e-6)


def obj_box(reach_m: tuple[float, float, float], sides: tuple[tuple[int, ...], ...]) -> str:
    """A box from the middle of ``CORNERS_M`` moved by ``reach_m``, as an OBJ file."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS_M + reach_m]
    return "\n".join([*lines, *("f " + " ".join(str(corner + 1) for corner in side) for side in sides)]) + "\n"


@pytest.mark.parametrize(("closed", "volume"), [(True, 8.0), (False, -8.0)])
def test_a_closed_mesh_that_is_inside_out_is_turned(closed: bool, volume: float, tmp_path: Path) -> None:
    """An open one, here without its last side, may face either way: nothing is guessed."""
    inwards = tuple(side[::-1] for side in SIDES)
    mesh, _, assumed = drawn(obj_box((0.0, 0.0, 0.0), inwards if closed else inwards[:5]), "box.obj", tmp_path)
    assert mesh.is_watertight == closed
    assert np.sign(mesh.volume) == np.sign(volume)
    assert ("mesh package://small/box.obj" in assumed) == closed


@pytest.mark.parametrize(("ahead_m", "named"), [(0.0, False), (0.06, False), (0.12, True)])
def test_a_mass_outside_of_the_shapes_of_its_link_is_named(ahead_m: float, named: bool, tmp_path: Path) -> None:
    """A mesh in left-handed axes is on the other side of the mass; 5 cm are inside, 1 cm outside is not named."""
    root = ET.fromstring(Humanoid().urdf())
    pelvis = root.find("link[@name='pelvis']")
    assert pelvis is not None
    for shape in (*pelvis.findall("collision"), *pelvis.findall("visual")):
        pelvis.remove(shape)
    ET.SubElement(
        ET.SubElement(ET.SubElement(pelvis, "visual"), "geometry"), "mesh", filename="package://small/box.obj"
    )
    upload = tmp_path / "upload"
    box = obj_box((ahead_m, 0.0, 0.0), SIDES)
    upload.write_bytes(archive({"small/small.urdf": ET.tostring(root, encoding="unicode"), "small/box.obj": box}))
    assumed = rebuild_description(upload, "small.zip", "small", tmp_path / "robots")
    assert ("link pelvis: centre of mass" in assumed) == named
    assert not named or "7 cm outside" in assumed["link pelvis: centre of mass"]
