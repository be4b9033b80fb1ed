"""From the shapes of a description to those that are checked against each other: convex hulls, without futile pairs."""

import re
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path

import coal
import pinocchio as pin

from stridelab.robots.card import CollisionCard


def collision_model(
    model: pin.Model, collision: pin.GeometryModel, visual: pin.GeometryModel, card: CollisionCard, srdf: Path | None
) -> pin.GeometryModel:
    """The shapes that can touch, with the pairs that are checked: all but those that the card or the SRDF excludes.

    Shapes that hang on the same joint are no pair. A mesh is replaced by its convex hull unless the card keeps it.
    """
    chosen = pin.GeometryModel()
    for original in collision.geometryObjects:
        if not matches(card.left_out, original.name):
            chosen.addGeometryObject(original if matches(card.meshes, original.name) else hull(original))
    for original in visual.geometryObjects:
        if matches(card.visual, original.name):
            part = original if matches(card.meshes, original.name) else hull(original)
            chosen.addGeometryObject(renamed(part, f"{part.name} (visual)"))
    links = [str(model.frames[part.parentFrame].name) for part in chosen.geometryObjects]
    joints = [part.parentJoint for part in chosen.geometryObjects]
    for i, k in combinations(range(chosen.ngeoms), 2):
        if joints[i] != joints[k] and not excluded(card.never, links[i], links[k]):
            chosen.addCollisionPair(pin.CollisionPair(i, k))
    if srdf is not None:
        pin.removeCollisionPairs(model, chosen, str(srdf), False)
    return chosen


def hull(original: pin.GeometryObject) -> pin.GeometryObject:
    """The same part with the convex hull of its mesh; a primitive shape stays what it is."""
    part = original.copy()
    if isinstance(part.geometry, coal.BVHModelBase):
        # buildConvexRepresentation would take the triangles as if they were convex already
        part.geometry.buildConvexHull(True, "Qt")
        part.geometry = part.geometry.convex
    return part


def renamed(original: pin.GeometryObject, name: str) -> pin.GeometryObject:
    """The same part under another name: a visual shape is often called like the collision shape of its link."""
    part = original.copy()
    part.name = name
    return part


def excluded(never: Mapping[str, tuple[str, ...]], link: str, other: str) -> bool:
    """Whether the card says, of either link, that it is not checked against the other."""
    return any(
        (re.fullmatch(one, link) and matches(others, other)) or (re.fullmatch(one, other) and matches(others, link))
        for one, others in never.items()
    )


def matches(patterns: tuple[str, ...], name: str) -> bool:
    """Whether one of the patterns matches the whole name."""
    return any(re.fullmatch(pattern, name) for pattern in patterns)
