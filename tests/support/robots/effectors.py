"""Effectors of a robot of TALOS' size with round reach limits, and scenarios changed for the judge."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from stridelab.contacts.effector_geometry import EffectorReach, EffectorShape
from stridelab.contacts.validation.validate import ValidationReport, validate_scenario

Made = dict[str, Any]
Change = Callable[[Made], None]

FOOT_REACH = EffectorReach((-0.9, -0.6, -0.1), (0.7, 0.6, 1.0), 1.05)
HAND_REACH = EffectorReach((-0.9, -0.9, -0.7), (0.9, 0.9, 0.9), 1.2)

SHAPES = {
    "left_foot": EffectorShape("surface", (0.10, 0.06), FOOT_REACH),
    "right_foot": EffectorShape("surface", (0.10, 0.06), FOOT_REACH),
    "left_hand": EffectorShape("point", None, HAND_REACH),
    "right_hand": EffectorShape("point", None, HAND_REACH),
}


def contact(scenario: Made, phase: int, effector: str) -> Made:
    found: Made
    (found,) = (c for c in scenario["phases"][phase]["contacts"] if c["effector"] == effector)
    return found


def everywhere(scenario: Made, effector: str, place: tuple[float, float, float], **change: Any) -> None:
    """Change all contacts of an effector at one place, as a drag in the viewer does."""
    for phase in scenario["phases"]:
        for entry in phase["contacts"]:
            if entry["effector"] == effector and np.allclose(entry["position_m"], place, atol=1e-6):
                entry.update(change)


def judged(scenario: Made, change: Change, shapes: Mapping[str, EffectorShape] = SHAPES) -> ValidationReport:
    change(scenario)
    return validate_scenario(scenario, shapes)


def faults(report: ValidationReport) -> list[tuple[str, str]]:
    """Places and messages, which go on after the place: no message begins with a capital letter."""
    found = [(fault.where, fault.message) for fault in report.faults]
    assert not any(message[0].isupper() for _, message in found)
    return found
