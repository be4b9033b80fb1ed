"""Soft shadows: a round spot below each foot, on the highest surface under it, which costs one draw call."""

from collections.abc import Mapping
from typing import Final

import numpy as np

from stridelab.schemas.scenarios import BoxSurface, Scenario
from stridelab_web.scene.contacts import box_rotation, rotation_matrix
from stridelab_web.scene.frames import Point, Sheet

SHADOW: Final = "shadow/"
"""Part of the name of a shadow, after that of the group with which it is hidden."""
LIFT_M: Final = 0.004
"""Height above the surface, so that the shadow is drawn over it."""
SUNK_M: Final = 0.03
"""A surface that is higher above the middle of a sole is beside the foot."""
STEEPEST: Final = 0.5
"""Vertical component of the normal from which a face holds a shadow."""


def shadow_points(
    sheet: Sheet, group: str, feet_m: Mapping[str, np.ndarray], ground_m: Mapping[str, np.ndarray]
) -> list[Point]:
    """A shadow for each foot of ``feet_m`` ``(frames, 3)`` at the heights ``ground_m`` ``(frames,)``; NaN for none."""
    return [
        Point(f"{group}{SHADOW}{foot}", sheet.add_block(np.column_stack([place_m[:, :2], ground_m[foot] + LIFT_M])), "")
        for foot, place_m in feet_m.items()
    ]


def is_shadow(point: Point) -> bool:
    """Whether ``point`` is one of ``shadow_points``."""
    return f"/{SHADOW}" in point.name


def sole_places_m(scenario: Scenario, links_m: np.ndarray) -> dict[str, np.ndarray]:
    """Middles ``(frames, 3)`` of the soles on which a motion begins, of the poses ``links_m`` ``(frames, links, 7)``.

    A sole moves with the link whose origin is nearest to its first place.
    """
    places_m = {}
    for contact in scenario.phases[0].contacts:
        if not contact.effector.endswith("foot"):
            continue
        sole_m = np.array(contact.position_m)
        link = links_m[:, int(np.argmin(np.linalg.norm(links_m[0, :, :3] - sole_m, axis=1)))]
        offset_m = rotation_matrix(tuple(link[0, 3:])).T @ (sole_m - link[0, :3])
        places_m[contact.effector] = np.array([pose[:3] + rotation_matrix(tuple(pose[3:])) @ offset_m for pose in link])
    return places_m


def ground_below_m(scenario: Scenario, place_m: np.ndarray) -> np.ndarray:
    """Height ``(n,)`` of the highest box below each of the places ``(n, 3)``; NaN where there is none."""
    ground_m = np.full(len(place_m), np.nan)
    for box in scenario.terrain:
        if not isinstance(box, BoxSurface):
            continue
        R, half_m = box_rotation(box), np.array(box.size_m) / 2
        n, top_m = R[:, 2], np.array(box.center_m) + half_m[2] * R[:, 2]
        if n[2] < STEEPEST:
            continue
        height_m = top_m[2] - (place_m[:, :2] - top_m[:2]) @ n[:2] / n[2]
        on_face_m = (np.column_stack([place_m[:, :2], height_m]) - top_m) @ R[:, :2]
        below = (np.abs(on_face_m) <= half_m[:2]).all(axis=1) & (height_m <= place_m[:, 2] + SUNK_M)
        ground_m = np.where(below, np.fmax(ground_m, height_m), ground_m)
    return ground_m
