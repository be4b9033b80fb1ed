"""Where a sole may stand, point by point against soles that are laid there and tried."""

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.contacts.planner.foothold_regions import PIECES_MAX, Region, foothold_regions
from stridelab.contacts.planner.step_limits import EffectorLimits
from stridelab.contacts.terrain import Box, Rail, Terrain
from stridelab.dynamics.spatial import Placement

ANY = EffectorReach((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 2.0)
SOLE = EffectorLimits("surface", (0.10, 0.05), ANY, ANY)
HAND = EffectorLimits("point", (0.0, 0.0), ANY, ANY)
FLOOR = Box("floor", Placement.from_wxyz([0.2, 0.1, -0.05]), np.array([1.0, 0.8, 0.1]))
CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)], float)


def box(x_m: float, y_m: float, low_m: float, high_m: float, yaw_rad: float = 0.0) -> Box:
    """An obstacle of 0.2 m by 0.1 m."""
    turn = [float(np.cos(yaw_rad / 2)), 0.0, 0.0, float(np.sin(yaw_rad / 2))]
    return Box("box", Placement.from_wxyz([x_m, y_m, (low_m + high_m) / 2], turn), np.array([0.2, 0.1, high_m - low_m]))


def floor_regions(
    yaw_rad: float, gap_m: float, *others: Box, friction: float = 0.3, floor: Box = FLOOR
) -> list[Region]:
    return foothold_regions(Terrain.from_surfaces([floor, *others]), friction, SOLE, yaw_rad, gap_m)


def holds(region: Region, place_m: np.ndarray) -> bool:
    local = (place_m - region.origin_m) @ region.axes
    return bool((region.A @ local <= region.b).all())


def met(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two convex polygons ``(4, 2)`` have a point in common: mixtures of corners that are equal."""
    A = np.block([[one.T, -other.T], [np.ones(4), np.zeros(4)], [np.zeros(4), np.ones(4)]])
    return bool(linprog(np.zeros(8), A_eq=A, b_eq=[0.0, 0.0, 1.0, 1.0]).status == 0)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.6])
def test_a_sole_fits_exactly_where_the_regions_say(yaw_rad: float) -> None:
    """On the floor, beside two obstacles; what ends below 1 cm or begins above 10 cm is none."""
    walls = (box(0.3, 0.1, 0.0, 0.3, 0.4), box(-0.1, 0.35, 0.09, 0.5))
    ignored = (box(0.3, -0.1, 0.0, 0.009), box(0.0, 0.0, 0.101, 0.4))
    room = [region for region in floor_regions(yaw_rad, 0.0, *walls, *ignored) if region.surface == "floor"]
    turn = ScipyRotation.from_euler("z", yaw_rad).as_matrix()[:2, :2]
    sole = CORNERS * [0.10, 0.05] @ turn.T
    rng = np.random.default_rng(3)
    answers = []
    for x, y in rng.uniform([-0.35, -0.35], [0.75, 0.55], (60, 2)):
        laid = sole + np.array([x, y])
        on_floor = (np.abs(laid - [0.2, 0.1]) <= [0.5, 0.4]).all()
        shadows = [CORNERS * [0.1, 0.05] @ w.placement.rotation[:2, :2].T + w.placement.position_m[:2] for w in walls]
        fits = bool(on_floor) and not any(met(laid, shadow) for shadow in shadows)
        assert any(holds(region, np.array([x, y, 0.0])) for region in room) == fits
        answers.append(fits)
    assert 10 < sum(answers) < 50
    for region in room:
        np.testing.assert_allclose(region.rotation[:, 0], [np.cos(yaw_rad), np.sin(yaw_rad), 0.0], atol=1e-12)
        np.testing.assert_allclose(region.corners_m[:, 2], 0.0, atol=1e-12)


def test_the_gap_to_every_edge_is_observed_where_there_is_room() -> None:
    """0.5 m and 0.4 m less the sole less the gap; a strip 0.16 m wide leaves 0.03 m, of which a tenth remains."""
    (region,) = floor_regions(0.0, 0.05)
    np.testing.assert_allclose(region.corners_m.min(axis=0), [0.2 - 0.35, 0.1 - 0.30, 0.0], atol=1e-12)
    np.testing.assert_allclose(region.corners_m.max(axis=0), [0.2 + 0.35, 0.1 + 0.30, 0.0], atol=1e-12)
    narrow = Box("strip", Placement.from_wxyz([0.0, 0.0, 0.0]), np.array([1.0, 0.16, 0.1]))
    (strip,) = floor_regions(0.0, 0.05, floor=narrow)
    np.testing.assert_allclose(strip.corners_m.max(axis=0), [0.4 - 0.027, 0.003, 0.05], atol=1e-9)
    assert floor_regions(0.0, 0.05, floor=Box("beam", Placement.identity(), np.array([1.0, 0.09, 0.1]))) == []
    assert len(floor_regions(0.0, 0.05, floor=Box("just", Placement.identity(), np.array([0.2, 0.1, 0.1])))) == 1


@pytest.mark.parametrize(("friction", "own", "stands"), [(0.3, None, False), (0.4, None, True), (0.3, 0.4, True)])
def test_a_face_steeper_than_its_friction_carries_nothing(friction: float, own: float | None, stands: bool) -> None:
    """20 degrees, tan 0.364; the sole's frame lies in the face, its x as far ahead as that allows."""
    turn = ScipyRotation.from_euler("y", -20.0, degrees=True)
    ramp = Box("ramp", Placement.from_wxyz([0.0, 0.0, 0.0], turn.as_quat(scalar_first=True).tolist()), np.ones(3), own)
    room = floor_regions(0.0, 0.0, floor=ramp, friction=friction)
    assert len(room) == stands
    for region in room:
        np.testing.assert_allclose(region.rotation, turn.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(region.corners_m @ turn.as_matrix()[:, 2], 0.5, atol=1e-12)


@pytest.mark.parametrize(("gap_m", "half_m"), [(0.05, 0.45), (2.0, 0.05)])
def test_a_hand_keeps_from_the_ends_of_a_rail_and_points_ahead(gap_m: float, half_m: float) -> None:
    """A rail of 1 m that was drawn from its far end; posts are none."""
    rail = Rail("rail", np.array([1.0, 0.5, 0.9]), np.array([0.0, 0.5, 0.9]), 0.02)
    post = Rail("post", np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.02)
    (region,) = foothold_regions(Terrain.from_surfaces([FLOOR, rail, post]), 0.3, HAND, 0.1, gap_m)
    np.testing.assert_allclose(region.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.sort(region.corners_m[:, 0]), [0.5 - half_m, 0.5 + half_m], atol=1e-12)
    np.testing.assert_allclose(region.corners_m[:, 1:], [[0.5, 0.92]] * 2, atol=1e-12)
    ends = [
        holds(region, np.array([0.5 + sign * (half_m + more), 0.5, 0.92])) for sign in (-1, 1) for more in (-1e-6, 1e-6)
    ]
    assert ends == [True, False, True, False]


def test_of_many_obstacles_the_largest_pieces_remain() -> None:
    """A field of posts on a large floor leaves more pieces than the planner uses, and no piece lies in another."""
    floor = Box("floor", Placement.from_wxyz([0.0, 0.0, -0.05]), np.array([3.0, 3.0, 0.1]))
    posts = [box(x, y, 0.0, 0.5, x) for x, y in np.random.default_rng(0).uniform(-1.3, 1.3, (4, 2))]
    room = [region for region in floor_regions(0.0, 0.0, *posts, floor=floor) if region.surface == "floor"]
    assert len(room) == PIECES_MAX
    areas = [ConvexHull(region.corners_m[:, :2]).volume for region in room]
    assert areas == sorted(areas, reverse=True)
    for i, one in enumerate(room):
        for k, other in enumerate(room):
            corners = (one.corners_m - other.origin_m) @ other.axes
            assert i == k or (corners @ other.A.T > other.b + 1e-6).any()


def test_a_piece_loses_the_gap_or_nine_tenths_of_its_largest_circle() -> None:
    """Against the linear program of the largest circle: pieces beside turned posts, and strips at the change-over."""
    floor = Box("floor", Placement.from_wxyz([0.0, 0.0, -0.05]), np.array([1.6, 1.6, 0.1]))
    posts = [box(x, y, 0.0, 0.5, x) for x, y in np.random.default_rng(0).uniform(-0.6, 0.6, (3, 2))]
    cases = [(floor, posts)]
    for radius_m in (0.04, 0.05, 0.0555, 0.0556, 0.06):
        size_m = np.array([1.0, 2.0 * (radius_m + SOLE.half_size_m[1]), 0.1])
        cases.append((Box("strip", Placement.identity(), size_m), []))
    narrow = []
    for face, others in cases:
        whole, shrunk = (
            [region for region in floor_regions(0.0, gap_m, *others, floor=face) if region.surface == face.name]
            for gap_m in (0.0, 0.05)
        )
        assert len(whole) == len(shrunk) > 0
        for one, other in zip(whole, shrunk, strict=True):
            circle = linprog([0, 0, -1], np.hstack([one.A, np.ones((len(one.A), 1))]), one.b, bounds=[(None, None)] * 3)
            np.testing.assert_allclose(one.b - other.b, min(0.05, 0.9 * circle.x[2]), atol=1e-9)
            narrow.append(bool(0.9 * circle.x[2] < 0.05))
    assert sum(narrow) > 3
    assert len(narrow) - sum(narrow) > 3
