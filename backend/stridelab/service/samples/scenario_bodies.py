"""Example scenarios of the OpenAPI document; the tests send them as well."""

from typing import Any, Final

_LEFT: Final[Any] = {"effector": "left_foot", "position_m": [0.0, 0.09, 0.0]}
_RIGHT: Final[Any] = {"effector": "right_foot", "position_m": [0.0, -0.09, 0.0]}
_AHEAD: Final[Any] = {"effector": "left_foot", "position_m": [0.2, 0.09, 0.0]}

ONE_STEP: Final[dict[str, Any]] = {
    "name": "One step",
    "robot": "talos",
    "friction": 0.5,
    "terrain": [{"name": "floor", "kind": "box", "center_m": [0.0, 0.0, -0.1], "size_m": [4.0, 2.0, 0.2]}],
    "phases": [
        {"duration_s": 1.0, "contacts": [_LEFT, _RIGHT]},
        {"duration_s": 1.0, "contacts": [_RIGHT]},
        {"duration_s": 1.0, "contacts": [_AHEAD, _RIGHT]},
    ],
}
"""A step of 20 cm with the left foot on a flat floor, from rest to rest."""

STANDING: Final[Any] = {"contacts": [_LEFT, _RIGHT]}
STANDING_AHEAD: Final[Any] = {
    "contacts": [{**foot, "position_m": [0.5, foot["position_m"][1], 0.0]} for foot in (_LEFT, _RIGHT)]
}
"""Both feet side by side, half a metre ahead of ``STANDING``."""

IN_THE_AIR: Final[dict[str, Any]] = {
    **ONE_STEP,
    "name": "A foot in the air",
    "phases": [{"duration_s": 1.0, "contacts": [_LEFT, {**_RIGHT, "position_m": [0.0, -0.09, 0.3]}]}],
}
"""An invalid scenario: the right foot is 0.3 m above the floor."""
