"""A scenario drawn from the side or from above, as shapes for an SVG.

The picture is a sketch to recognise a scenario by: a footprint is drawn 0.20 m by 0.12 m whatever the robot.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stridelab.schemas.scenarios import BoxSurface, Scenario
from stridelab_web.formatting import count_text
from stridelab_web.scene.contacts import PlacedContact, box_corners_m, placed_contacts, rotation_matrix

PX_PER_M: Final = 200.0
MARGIN_M: Final = 0.25
SOLE_M: Final = (0.20, 0.12)
HAND_M: Final = (0.06, 0.06)
SOLE_THICKNESS_M: Final = 0.035
MAX_SURROUNDINGS_M: Final = 0.5
"""Maximum distance from the contacts at which surroundings are drawn."""

View = Literal["side", "above"]


@dataclass(frozen=True)
class Shape:
    """A polygon (``points`` of an SVG) with a class, a label and where the label stands."""

    points: str
    css: str
    text: str = ""
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True)
class Drawing:
    """Shapes from back to front inside ``width`` by ``height``."""

    width: float
    height: float
    shapes: tuple[Shape, ...]
    description: str
    origin_m: tuple[float, float] = (0.0, 0.0)
    """World coordinates of the upper left corner along the two axes of the view."""

    def to_px(self, point_m: Sequence[float]) -> tuple[float, float]:
        """Position of a point with the two coordinates of the view."""
        x, y = ((point_m[0] - self.origin_m[0]) * PX_PER_M, (self.origin_m[1] - point_m[1]) * PX_PER_M)
        return round(x, 1), round(y, 1)


def draw_scenario(scenario: Scenario, view: View, region_m: Sequence[tuple[float, float]] = ()) -> Drawing | None:
    """The scenario seen from its right side, or from above with ``region_m`` over it.

    None for a scenario without contacts.
    """
    contacts = placed_contacts(scenario)
    if not contacts:
        return None
    axes = (0, 2) if view == "side" else (0, 1)
    places = np.array([touch.contact.position_m for touch in contacts])[:, axes]
    low, high = places.min(axis=0), places.max(axis=0)
    boxes = [box_corners_m(surface)[:, axes] for surface in scenario.terrain if isinstance(surface, BoxSurface)]
    rails = [
        np.array([surface.from_m, surface.to_m])[:, axes]
        for surface in scenario.terrain
        if not isinstance(surface, BoxSurface)
    ]
    near_low, near_high = low - MAX_SURROUNDINGS_M, high + MAX_SURROUNDINGS_M
    for cloud in (*boxes, *rails):
        cut = np.clip(cloud, near_low, near_high)
        low, high = np.minimum(low, cut.min(axis=0)), np.maximum(high, cut.max(axis=0))
    if view == "side":  # of the ground only its upper edge says anything
        low[1] = max(low[1], places[:, 1].min() - 0.08)
    low, high = low - MARGIN_M, high + MARGIN_M

    def to_px(points: np.ndarray) -> np.ndarray:
        inside = np.clip(points, low - 1.0, high + 1.0)
        return np.asarray((inside - [low[0], high[1]]) * [PX_PER_M, -PX_PER_M])

    shapes = [_polygon_shape(to_px(_convex_outline(cloud)), f"box {view}") for cloud in boxes]
    shapes += [_polygon_shape(to_px(_rail_outline(rail)), "rail") for rail in rails]
    shapes += [_footprint_shape(touch, view, axes, to_px) for touch in contacts]
    if len(region_m) > 2:
        shapes.append(_polygon_shape(to_px(np.array(region_m)), "support"))
    width, height = (high - low) * PX_PER_M
    side = "from the side" if view == "side" else "from above"
    text = f"{scenario.name} {side}: {count_text(len(contacts), 'contact')}"
    origin_m = (float(low[0]), float(high[1]))
    return Drawing(round(float(width), 1), round(float(height), 1), tuple(shapes), text, origin_m)


def _footprint_shape(
    touch: PlacedContact, view: View, axes: tuple[int, int], to_px: Callable[[np.ndarray], np.ndarray]
) -> Shape:
    hand = "hand" in touch.effector
    edges = np.array(HAND_M if hand else SOLE_M) / 2
    corners = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) * [*edges, 0]
    R = rotation_matrix(touch.contact.orientation_wxyz)
    flat = touch.contact.position_m + corners @ R.T
    if view == "side":
        flat = np.concatenate([flat, flat + R @ [0, 0, SOLE_THICKNESS_M]])
    px = to_px(flat[:, axes])
    centre = to_px(np.array([touch.contact.position_m])[:, axes])[0]
    css = "hand" if hand else "left" if touch.effector.startswith("left") else "right"
    above = -12.0 if view == "side" else 4.0
    return _polygon_shape(
        _convex_outline(px), f"touch {css}", str(touch.number), float(centre[0]), float(centre[1]) + above
    )


def _convex_outline(points: np.ndarray) -> np.ndarray:
    """Convex outline of points of the plane (Andrew's monotone chain); the points themselves where they span no area.

    Written without scipy, whose import would take a tenth of the web server's start.
    """
    along = sorted(tuple(point) for point in points.tolist())
    outline = [*_left_of(along), *_left_of(along[::-1])]
    return np.array(outline) if len(outline) > 2 else points


def _left_of(along: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """The chain of left turns through the points, without its last point."""
    chain: list[tuple[float, ...]] = []
    for x, y in along:
        while len(chain) > 1 and _cross_product(chain[-2], chain[-1], (x, y)) <= 0.0:
            chain.pop()
        chain.append((x, y))
    return chain[:-1]


def _cross_product(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _rail_outline(ends: np.ndarray) -> np.ndarray:
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    across = np.array([-along[1], along[0]]) / length * 0.02 if length > 0 else np.zeros(2)
    return np.array([ends[0] + across, ends[1] + across, ends[1] - across, ends[0] - across])


def _polygon_shape(px: np.ndarray, css: str, text: str = "", x: float = 0.0, y: float = 0.0) -> Shape:
    return Shape(" ".join(f"{u:.1f},{v:.1f}" for u, v in px), css, text, round(x, 1), round(y, 1))
