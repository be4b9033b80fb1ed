"""Archives and descriptions of robots that no one should send."""

import io
import stat
import struct
import tarfile
import zipfile
from collections.abc import Callable

from support.robots.humanoid import Humanoid, archive, box_stl

GOOD = Humanoid(arms=False).urdf()
MESHED = Humanoid(arms=False, mesh_feet="package://x/meshes/foot.stl").urdf()


def with_link_file() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        link = zipfile.ZipInfo("robot.urdf")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        target.writestr(link, "/etc/passwd")
    return packed.getvalue()


def with_link_folder() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        link = zipfile.ZipInfo("meshes")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        target.writestr(link, "/etc")
        target.writestr("robot.urdf", GOOD)
    return packed.getvalue()


def encrypted() -> bytes:
    """A zip whose entry claims to be encrypted."""
    packed = bytearray(one(GOOD))
    packed[6] |= 1
    packed[packed.rfind(b"PK\x01\x02") + 8] |= 1
    return bytes(packed)


def tar_archive() -> bytes:
    packed, content = io.BytesIO(), GOOD.encode()
    with tarfile.open(fileobj=packed, mode="w:gz") as target:
        member = tarfile.TarInfo("robot.urdf")
        member.size = len(content)
        target.addfile(member, io.BytesIO(content))
    return packed.getvalue()


def nan_stl() -> bytes:
    return bytes(80) + struct.pack("<I", 4) + struct.pack("<12fH", *[float("nan")] * 12, 0) * 4


def named_twice() -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as target:
        target.writestr("robot.urdf", GOOD)
        target.writestr("Robot.urdf", GOOD)
    return packed.getvalue().replace(b"Robot.urdf", b"robot.urdf")


def one(urdf: str) -> bytes:
    return archive({"robot.urdf": urdf})


BILLION = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
    '<robot name="x"><link name="&b;"/></robot>'
)
EXTERNAL = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="x"><link name="&x;"/></robot>'
XACRO = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="x">{}</robot>'
COLLADA = "<!DOCTYPE c [<!ENTITY a 'ha'><!ENTITY b '&a;&a;'>]><COLLADA>&b;</COLLADA>"
JOINT = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
LINKS = '<link name="a"/><link name="b"/><link name="c"/>'
HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    "an empty file": (lambda: b"", "zip-damaged"),
    "an empty zip": (lambda: archive({}), "robot-description-missing"),
    "a tar": (tar_archive, "zip-damaged"),
    "a zip with a password": (encrypted, "zip-damaged"),
    "a folder that is a link": (with_link_folder, "zip-path"),
    "a network folder": (lambda: archive({"\\\\host\\share\\robot.urdf": GOOD}), "zip-path"),
    "an unexpanded macro": (lambda: one(XACRO.format("<xacro:leg side='left'/>")), "robot-data-unreadable"),
    "an expression": (lambda: one(GOOD.replace('mass value="8.0"', 'mass value="${m}"')), "robot-data-unreadable"),
    "an entity outside": (
        lambda: one('<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1/x"> %p;]><robot name="x"/>'),
        "robot-data-unreadable",
    ),
    "an unknown encoding": (
        lambda: one('<?xml version="1.0" encoding="utf-7"?><robot name="x"/>'),
        "robot-data-unreadable",
    ),
    "its own parent": (
        lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'b')}{JOINT.format('2', 'c', 'c')}</robot>"),
        "robot-description-invalid",
    ),
    "a name that is written backwards": (
        lambda: one(GOOD.replace('"left_knee"', '"left_\u202eeenk"')),
        "robot-description-invalid",
    ),
    "bodies multiplied a thousandfold": (
        lambda: one(
            "<mujoco><worldbody>"
            + '<replicate count="1000">' * 3
            + "<body/>"
            + "</replicate>" * 3
            + "</worldbody></mujoco>"
        ),
        "robot-description-invalid",
    ),
    "a grid of flexible bodies": (
        lambda: one('<mujoco><worldbody><flexcomp name="f" type="grid" count="200 200 200"/></worldbody></mujoco>'),
        "robot-description-invalid",
    ),
    "a mesh of no numbers": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": nan_stl()}),
        "robot-mesh-unreadable",
    ),
    "entities in a mesh": (
        lambda: archive({"robot.urdf": MESHED.replace("foot.stl", "foot.dae"), "meshes/foot.dae": COLLADA}),
        "robot-mesh-unreadable",
    ),
    "no zip": (lambda: b"PK\x03\x04 not a zip", "zip-damaged"),
    "half a zip": (lambda: one(GOOD)[:300], "zip-damaged"),
    "a path upwards": (lambda: archive({"../../robot.urdf": GOOD}), "zip-path"),
    "an absolute path": (lambda: archive({"/tmp/robot.urdf": GOOD}), "zip-path"),
    "a drive": (lambda: archive({"C:\\robot.urdf": GOOD}), "zip-path"),
    "a symbolic link": (with_link_file, "zip-path"),
    "the same name twice": (named_twice, "zip-name-twice"),
    "no description": (lambda: archive({"readme.txt": "hello"}), "robot-description-missing"),
    "two descriptions": (lambda: archive({"a.urdf": GOOD, "b.urdf": GOOD}), "robot-several-descriptions"),
    "entities": (lambda: one(BILLION), "robot-data-unreadable"),
    "an external entity": (lambda: one(EXTERNAL), "robot-data-unreadable"),
    "no XML": (lambda: one("<robot"), "robot-data-unreadable"),
    "binary": (lambda: one("\x00\x01"), "robot-data-unreadable"),
    "an empty MJCF": (lambda: one("<mujoco/>"), "robot-description-invalid"),
    "depth": (lambda: one("<robot>" * 100 + "</robot>" * 100), "robot-description-too-large"),
    "a cycle": (
        lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'b')}{JOINT.format('2', 'b', 'a')}</robot>"),
        "robot-description-invalid",
    ),
    "two roots": (lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'b')}</robot>"), "robot-description-invalid"),
    "two parents": (
        lambda: one(f"<robot>{LINKS}{JOINT.format('1', 'a', 'c')}{JOINT.format('2', 'b', 'c')}</robot>"),
        "robot-description-invalid",
    ),
    "markup in a name": (
        lambda: one(GOOD.replace('"left_knee"', '"&lt;script&gt;alert(1)&lt;/script&gt;"')),
        "robot-description-invalid",
    ),
    "a name of line breaks": (
        lambda: one(GOOD.replace('"left_knee"', '"left&#10;knee"')),
        "robot-description-invalid",
    ),
    "not a number": (lambda: one(GOOD.replace('mass value="8.0"', 'mass value="nan"')), "robot-description-invalid"),
    "infinity": (lambda: one(GOOD.replace('mass value="8.0"', 'mass value="1e400"')), "robot-description-invalid"),
    "no axis": (lambda: one(GOOD.replace('xyz="0.0 1.0 0.0"', 'xyz="0 0 0"')), "robot-description-invalid"),
    "degrees": (lambda: one(GOOD.replace('upper="2.3"', 'upper="130"')), "robot-description-invalid"),
    "included files that are deep": (
        lambda: archive(
            {
                f"p{i}.xml": "<mujoco>"
                + "<body>" * 30
                + f"<include file='p{i + 1}.xml'/>"
                + "</body>" * 30
                + "</mujoco>"
                for i in range(3)
            }
            | {"p3.xml": "<mujoco/>"}
        ),
        "robot-description-too-large",
    ),
    "included files that are large": (
        lambda: archive(
            {"a.xml": "<mujoco><include file='b.xml'/></mujoco>", "b.xml": f"<mujoco>{' ' * 7_999_990}</mujoco>"}
        ),
        "robot-description-too-large",
    ),
    "a missing mesh": (lambda: one(MESHED), "robot-description-invalid"),
    "a broken mesh": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": b"solid nothing"}),
        "robot-mesh-unreadable",
    ),
    "a cut mesh": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": box_stl((0.1, 0.05, 0.02))[:200]}),
        "robot-mesh-unreadable",
    ),
    "a mesh in millimetres": (
        lambda: archive({"robot.urdf": MESHED, "meshes/foot.stl": box_stl((100.0, 50.0, 20.0))}),
        "robot-mesh-unreadable",
    ),
}


def many_named_entries() -> bytes:
    """A zip whose list of contents is long, though each of its files is empty."""
    return archive({f"meshes/{i}.stl": b"" for i in range(60_000)})


def swollen_mesh() -> bytes:
    """A zip of 1 MB that holds a mesh of 1 GB."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as target:
        target.writestr("robot.urdf", MESHED)
        with target.open("meshes/foot.stl", "w", force_zip64=True) as mesh:
            for _ in range(1000):
                mesh.write(bytes(1_000_000))
    return packed.getvalue()


def swollen_description() -> bytes:
    """A description of 50 MB, most of it spaces."""
    return _deflated("robot.urdf", GOOD.replace("</robot>", " " * 50_000_000 + "</robot>").encode())


def promised_triangles() -> bytes:
    """A mesh whose header promises 4e9 triangles."""
    return archive({"robot.urdf": MESHED, "meshes/foot.stl": bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(5000)})


def long_wavefront() -> bytes:
    """A mesh of a million corners whose faces name corners that it lacks."""
    urdf = MESHED.replace("foot.stl", "foot.obj")
    mesh = "v 0 0 0\n" * 1_000_000 + "f 5000001 5000002 5000003\n"
    return archive({"robot.urdf": urdf, "meshes/foot.obj": mesh})


def many_links() -> bytes:
    """A description of more elements than are read, in less than its largest size."""
    return one("<robot>" + "".join(f'<link name="{i}"/>' for i in range(70_000)) + "</robot>")


def long_chain() -> bytes:
    """A chain of 10000 links, so that a search of the tree by recursion ends the process."""
    links = "".join(f'<link name="l{i}"/>' for i in range(10_000))
    return one(f"<robot>{links}{''.join(JOINT.format(i, f'l{i}', f'l{i + 1}') for i in range(9_999))}</robot>")


def long_attribute() -> bytes:
    """A description with one attribute of 7 MB."""
    return one(GOOD.replace('"left_knee"', f'"{"k" * 7_000_000}"'))


def many_shapes() -> bytes:
    """A link of 5000 boxes, whose pairs with those of the other links would be sampled for minutes."""
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    return one(GOOD.replace('<link name="torso">', f'<link name="torso">{box * 5000}'))


def including_itself() -> bytes:
    """An MJCF file that includes itself twice."""
    return archive({"robot.xml": "<mujoco><include file='robot.xml'/><include file='robot.xml'/></mujoco>"})


def doubled_includes() -> bytes:
    """Twenty MJCF files, each of which includes the next one twice: a million at the end."""
    files = {
        f"p{i}.xml": f"<mujoco><include file='p{i + 1}.xml'/><include file='p{i + 1}.xml'/></mujoco>" for i in range(20)
    }
    return archive({"robot.xml": "<mujoco><include file='p0.xml'/></mujoco>", **files, "p20.xml": "<mujoco/>"})


def _deflated(name: str, content: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as target:
        target.writestr(name, content)
    return packed.getvalue()


EXPENSIVE: dict[str, Callable[[], bytes]] = {
    "a list of 60000 files": many_named_entries,
    "a mesh that grows to 1 GB": swollen_mesh,
    "a description of 50 MB": swollen_description,
    "4e9 triangles in the header": promised_triangles,
    "a million corners without faces": long_wavefront,
    "70000 links": many_links,
    "a chain of 10000 links": long_chain,
    "a name of 7 MB": long_attribute,
    "a link of 5000 shapes": many_shapes,
    "a file that includes itself": including_itself,
    "files that include each other a millionfold": doubled_includes,
}
"""Archives that ask for time or memory; each is refused."""
