"""Conversion between scenarios in plain form (``schemas.scenarios.Scenario``) and ``ContactSequence``."""

from collections.abc import Mapping
from typing import Any

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.sequence import ContactSequence
from stridelab.contacts.terrain import Box, Surface
from stridelab.contacts.validation.validate import validate_and_build
from stridelab.errors import InvalidInput


def sequence_of(scenario: Mapping[str, Any], effectors: Mapping[str, EffectorShape]) -> ContactSequence:
    """Return the contact sequence of a scenario, with the surface and friction of every contact.

    Raises ``InvalidInput`` (``scenario-invalid``) with all faults.
    """
    report, sequence = validate_and_build(scenario, effectors)
    if sequence is None:
        first, more = report.faults[0], len(report.faults) - 1
        others = f" and {more} more" if more else ""
        message = f"The robot cannot do this: {first.where}: {first.message}{others}."
        raise InvalidInput("scenario-invalid", message, report.faults)
    return sequence


def scenario_of(sequence: ContactSequence, description: str = "") -> dict[str, Any]:
    """Return the plain form of a contact sequence."""
    height = sequence.start_com_height_m
    return {
        "name": sequence.name,
        "description": description,
        "robot": sequence.robot,
        "friction": sequence.friction,
        **({} if height is None else {"start_com_height_m": height}),
        "terrain": [_surface_to_dict(surface) for surface in sequence.terrain.surfaces],
        "phases": [
            {
                "duration_s": phase.duration_s,
                "contacts": [
                    {
                        "effector": contact.effector,
                        "position_m": contact.placement.position_m.tolist(),
                        "orientation_wxyz": contact.placement.wxyz.tolist(),
                    }
                    for contact in phase.contacts.values()
                ],
            }
            for phase in sequence.phases
        ],
    }


def _surface_to_dict(surface: Surface) -> dict[str, Any]:
    if isinstance(surface, Box):
        return {
            "name": surface.name,
            "kind": "box",
            "center_m": surface.placement.position_m.tolist(),
            "size_m": surface.size_m.tolist(),
            "orientation_wxyz": surface.placement.wxyz.tolist(),
            "friction": surface.friction,
        }
    return {
        "name": surface.name,
        "kind": "rail",
        "from_m": surface.from_m.tolist(),
        "to_m": surface.to_m.tolist(),
        "radius_m": surface.radius_m,
        "friction": surface.friction,
    }
