"""Names of links and joints of a stranger's URDF, and the tree that its joints make."""

import itertools
import unicodedata
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from stridelab.errors import Fault

MAX_LINKS: Final = 400
MAX_NAME: Final = 100
_SAFE: Final = frozenset(" _-.:+")


def simplify_names(links: Sequence[ET.Element], joints: Sequence[ET.Element]) -> dict[str, str]:
    """Remove spaces at the ends of names and replace slashes, also where joints refer to links; returns what changed.

    Slashes separate names of several robots in one simulation; here they would be those of paths.
    """
    simplified = {}
    for element in (*links, *joints):
        name = element.get("name", "")
        if (plain := _plain_name(name)) != name:
            element.set("name", plain)
            how = "without the spaces at its ends" if "/" not in name else "with _ in place of /"
            simplified[f"{element.tag} {plain[:MAX_NAME]}: name"] = how
    for end in (end for joint in joints for end in (*joint.findall("parent"), *joint.findall("child"))):
        end.set("link", _plain_name(end.get("link", "")))
    return simplified


def _plain_name(name: str) -> str:
    return name.strip().replace("/", "_")


def rename_joints(joints: Sequence[ET.Element], links: set[str]) -> dict[str, str]:
    """Rename joints that have the name of a link, since frames are addressed by name; returns what was renamed."""
    taken = links | {joint.attrib["name"] for joint in joints}
    renamed = {}
    for joint in joints:
        name = joint.attrib["name"]
        if name in links:
            new = next(new for k in itertools.count() if (new := f"{name}_joint{k or ''}") not in taken)
            joint.set("name", new)
            taken.add(new)
            renamed[f"joint {name}: name"] = f"{new}, since a link has the same name"
    return renamed


def name_and_tree_faults(links: Sequence[ET.Element], joints: Sequence[ET.Element]) -> list[Fault]:
    """Names that cannot be used, and if there are none, what prevents the joints from being a tree of one root."""
    named = [*_name_faults(links, "link"), *_name_faults(joints, "joint")]
    return named or list(_tree_faults(links, joints))


def _name_faults(elements: Sequence[ET.Element], kind: str) -> Iterator[Fault]:
    if not elements:
        yield Fault(kind, f"there is no <{kind}>")
    if len(elements) > MAX_LINKS:
        yield Fault(kind, f"there are {len(elements)}; at most {MAX_LINKS} are accepted")
    counts = Counter(element.get("name", "") for element in elements)
    for name, count in counts.items():
        shown = f"{kind} {name[:MAX_NAME]!r}"
        if count > 1:
            yield Fault(shown, "its name occurs more than once")
        if not name or len(name) > MAX_NAME:
            yield Fault(shown, f"its name must have 1 to {MAX_NAME} characters")
        elif not all(_is_safe(letter) for letter in name):
            yield Fault(shown, "its name may contain letters, digits, spaces and . : + - _ only")


def _is_safe(letter: str) -> bool:
    """Letters, digits and the marks that some alphabets combine them with, and ``_SAFE``."""
    return letter.isalnum() or letter in _SAFE or unicodedata.category(letter) in ("Mn", "Mc")


def joint_end(joint: ET.Element, which: str) -> str:
    """Name of the ``parent`` or ``child`` link of a joint; empty if it states none."""
    child = joint.find(which)
    return "" if child is None else child.get("link", "")


def _tree_faults(links: Sequence[ET.Element], joints: Sequence[ET.Element]) -> Iterator[Fault]:
    """Joints without links, links with several parents, cycles, several roots."""
    names = {link.get("name", "") for link in links}
    parent: dict[str, str] = {}
    for joint in joints:
        where = f"joint {joint.get('name')}"
        ends = joint_end(joint, "parent"), joint_end(joint, "child")
        for which, end in zip(("parent", "child"), ends, strict=True):
            if end not in names:
                yield Fault(where, f"its {which} is {end[:MAX_NAME]!r}, which is no link")
        if ends[1] in parent:
            yield Fault(where, f"link {ends[1]!r} has another parent already")
        parent[ends[1]] = ends[0]
    roots = sorted(names - parent.keys())
    if len(roots) > 1:
        yield Fault("link", f"there are {len(roots)} roots, {', '.join(roots[:5])}: a joint must connect them")
    for name in sorted(names):
        at, steps = name, 0
        while at in parent and steps <= len(names):
            at, steps = parent[at], steps + 1
        if steps > len(names):
            yield Fault(f"link {name}", "it is its own ancestor: the joints form a cycle")
            return
