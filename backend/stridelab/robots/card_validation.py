"""Checks that a card matches its description and that the description is a valid robot, field by field."""

import re
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from stridelab.errors import Fault
from stridelab.machine.models_folder import models_dir
from stridelab.robots.card import RobotCard, card_patterns, tables_by_joint
from stridelab.robots.robot import Effector
from stridelab.robots.self_collision import matches_any

TOLERANCE_RAD: Final = 1e-9
"""Rounding tolerance by which the reference posture may lie outside the joint limits."""
_WORDS: Final = {"joint": "joint", "link": "link", "part": "collision geometry", "visual": "visual geometry"}


def card_mismatches(
    card: RobotCard, model: pin.Model, collision: pin.GeometryModel, visual: pin.GeometryModel
) -> Iterator[Fault]:
    """Names in the card that the description lacks, and joints that the card assigns to no group or to several.

    ``model`` is the full model, with the postures of the SRDF.
    """
    joints, frames = list(model.names)[2:], {str(frame.name) for frame in model.frames}
    names_by_kind = {
        "joint": joints,
        "link": [str(frame.name) for frame in model.frames if frame.type == pin.FrameType.BODY],
        "part": [str(part.name) for part in collision.geometryObjects],
        "visual": [str(part.name) for part in visual.geometryObjects],
    }
    names_by_kind["part"] += [name for name in names_by_kind["visual"] if matches_any(card.collision.visual, name)]
    literature = (models_dir() / "references.bib").read_text(encoding="utf-8")
    for i, key in enumerate(card.references):
        if f"{{{key}," not in literature:
            yield Fault(f"references[{i}]", f"models/references.bib has no entry {key!r}")
    if card.base_frame not in frames:
        yield Fault("base_frame", f"there is no frame {card.base_frame!r}")
    postures = {item.key() for item in model.referenceConfigurations}
    if card.reference.posture is not None and card.reference.posture not in postures:
        yield Fault("reference.posture", f"there is no posture {card.reference.posture!r}")
    for where, kind, pattern in card_patterns(card):
        if not where.startswith("groups.") and not any(re.fullmatch(pattern, name) for name in names_by_kind[kind]):
            yield Fault(where, f"no {_WORDS[kind]} matches {pattern!r}")
    for where, table in tables_by_joint(card).items():
        for joint in joints:
            if sum(1 for pattern in table if re.fullmatch(pattern, joint)) > 1:
                yield Fault(where, f"joint {joint!r} is named by more than one pattern")
    for name, effector in card.effectors.items():
        if effector.frame not in frames:
            yield Fault(f"effectors.{name}.frame", f"there is no frame {effector.frame!r}")
        for joint in effector.ankle or ():
            if joint not in joints or matches_any(card.locked_joints, joint):
                yield Fault(f"effectors.{name}.ankle", f"there is no moving joint {joint!r}")
    for joint in joints:
        if matches_any(card.locked_joints, joint):
            continue
        groups = [group for group, pattern in card.groups.items() if re.fullmatch(pattern, joint)]
        if len(groups) != 1:
            yield Fault("groups", f"joint {joint!r} lies in {len(groups)} groups instead of one")
        if model.joints[model.getJointId(joint)].nq != 1:  # a continuous joint
            yield Fault("locked_joints", f"joint {joint!r} has no limits and must be locked")


def fixed_effectors(model: pin.Model, base_frame: str, effectors: Mapping[str, Effector]) -> Iterator[Fault]:
    """Effectors that no joint of the reduced ``model`` moves relative to the base."""
    base = set(model.supports[model.frames[model.getFrameId(base_frame)].parentJoint])
    for name, effector in effectors.items():
        own = set(model.supports[model.frames[model.getFrameId(effector.frame)].parentJoint])
        if own <= base:
            yield Fault(
                f"effectors.{name}.frame", f"no moving joint lies between {base_frame!r} and {effector.frame!r}"
            )


def joints_without_limits(model: pin.Model) -> Iterator[Fault]:
    """Joints of the reduced ``model`` without range, speed or torque."""
    for i, joint in enumerate(list(model.names)[2:]):
        low, high = model.lowerPositionLimit[7 + i], model.upperPositionLimit[7 + i]
        if not low < high:
            yield Fault(f"joint {joint}", f"its range is empty: from {low:g} to {high:g} rad")
        for what, value in (("velocity", model.velocityLimit[6 + i]), ("effort", model.effortLimit[6 + i])):
            if not 0.0 < value < np.inf:
                yield Fault(f"joint {joint}", f"its {what} limit is {value:g}; it must be positive")


def joints_out_of_range(model: pin.Model, q: Float[np.ndarray, "nq"]) -> Iterator[Fault]:
    """Joints whose angle in the reference posture ``q`` lies outside their range."""
    for i, joint in enumerate(list(model.names)[2:]):
        low, high, angle = model.lowerPositionLimit[7 + i], model.upperPositionLimit[7 + i], q[7 + i]
        if not low - TOLERANCE_RAD <= angle <= high + TOLERANCE_RAD:
            yield Fault("reference", f"joint {joint!r} is at {angle:g} rad, outside {low:g} to {high:g}")
