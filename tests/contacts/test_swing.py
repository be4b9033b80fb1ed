"""Swing curves: ends at rest, derivatives, apex, the profile of the stairs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation as ScipyRotation

from stridelab.contacts.effector_geometry import FOOT_CLEARANCE_M, sole_points_m
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.stairs import flat_walk, six_stairs, stairs_with_rail
from stridelab.contacts.sequence import Contact
from stridelab.contacts.sequence_swings import swing_of
from stridelab.contacts.swing import (
    HAND_RETREAT_M,
    MARGIN_M,
    PASSING_GAP_M,
    UP,
    SwingCurve,
    passing_shift_m,
    required_rise_m,
)
from stridelab.contacts.terrain import Box, Terrain, depth_in_box_m, vertical_span_m
from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.wholebody.effector_contact import SWING_SHARE
from support.robots.scenario_bodies import SHAPES

coordinate = st.floats(-1.0, 1.0)
position = st.tuples(coordinate, coordinate, coordinate)
rotation_vector = st.tuples(coordinate, coordinate, coordinate)


def placed(position_m: tuple[float, ...], rotvec: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Placement:
    return Placement(np.array(position_m), ScipyRotation.from_rotvec(rotvec).as_matrix())


placements = st.builds(placed, position, rotation_vector)
curves = st.builds(SwingCurve, placements, placements, st.floats(0.1, 3.0), st.sampled_from(["surface", "point"]))


def rotation_between(a: Placement, b: Placement) -> np.ndarray:
    """World-frame rotation vector from ``a`` to ``b``."""
    return ScipyRotation.from_matrix(b.rotation @ a.rotation.T).as_rotvec()


@settings(deadline=None)
@given(curves)
def test_begins_and_ends_at_rest_at_its_contacts(curve: SwingCurve) -> None:
    for t, goal in ((0.0, curve.start), (curve.duration_s, curve.end)):
        point = curve.state_at(t)
        np.testing.assert_allclose(point.placement.position_m, goal.position_m, atol=1e-12)
        np.testing.assert_allclose(point.placement.rotation, goal.rotation, atol=1e-12)
        for derivative in (
            point.velocity_m_s,
            point.acceleration_m_s2,
            point.angular_velocity_rad_s,
            point.angular_acceleration_rad_s2,
        ):
            np.testing.assert_allclose(derivative, 0.0, atol=1e-9)


@settings(deadline=None)
@given(curves, st.floats(0.01, 0.99))
def test_derivatives_are_those_of_the_placement(curve: SwingCurve, share: float) -> None:
    t, h = share * curve.duration_s, 1e-5 * curve.duration_s
    before, here, after = curve.state_at(t - h), curve.state_at(t), curve.state_at(t + h)
    scale = 1.0 / curve.duration_s
    velocity = (after.placement.position_m - before.placement.position_m) / (2 * h)
    acceleration = (after.velocity_m_s - before.velocity_m_s) / (2 * h)
    spin = rotation_between(before.placement, after.placement) / (2 * h)
    spin_rate = (after.angular_velocity_rad_s - before.angular_velocity_rad_s) / (2 * h)
    np.testing.assert_allclose(here.velocity_m_s, velocity, atol=1e-5 * scale)
    np.testing.assert_allclose(here.acceleration_m_s2, acceleration, atol=1e-1 * scale**2)
    np.testing.assert_allclose(here.angular_velocity_rad_s, spin, atol=1e-5 * scale)
    np.testing.assert_allclose(here.angular_acceleration_rad_s2, spin_rate, atol=1e-1 * scale**2)


@settings(deadline=None)
@given(curves, st.floats(0.0, 1.0))
def test_moves_without_jumps(curve: SwingCurve, share: float) -> None:
    t, h = share * curve.duration_s, 1e-7 * curve.duration_s
    here, next_ = curve.state_at(t), curve.state_at(t + h)
    np.testing.assert_allclose(next_.placement.position_m, here.placement.position_m, atol=1e-5)
    np.testing.assert_allclose(next_.velocity_m_s, here.velocity_m_s, atol=1e-4 / curve.duration_s)
    np.testing.assert_allclose(next_.acceleration_m_s2, here.acceleration_m_s2, atol=1e-2 / curve.duration_s**2)


@settings(max_examples=50, deadline=None)
@given(placements, placements, st.floats(0.1, 3.0))
def test_a_sole_rises_to_its_clearance_above_the_higher_place(
    start: Placement, end: Placement, duration: float
) -> None:
    curve = SwingCurve(start, end, duration, "surface")
    z = np.array([curve.state_at(t).placement.position_m[2] for t in np.linspace(0.0, duration, 41)])
    higher = max(start.position_m[2], end.position_m[2])
    assert z.max() - higher == pytest.approx(FOOT_CLEARANCE_M, abs=2e-3)
    assert curve.state_at(duration / 2).placement.position_m[2] - higher == pytest.approx(FOOT_CLEARANCE_M, abs=2e-3)


@settings(max_examples=50, deadline=None)
@given(placements, rotation_vector, st.floats(0.1, 3.0))
def test_a_hand_on_one_rail_retreats_along_its_normal(
    start: Placement, along: tuple[float, ...], duration: float
) -> None:
    n = start.rotation[:, 2]
    travel = np.array(along) - n * (n @ np.array(along))
    curve = SwingCurve(start, Placement(start.position_m + travel, start.rotation), duration, "point")
    off = np.array(
        [(curve.state_at(t).placement.position_m - start.position_m) @ n for t in np.linspace(0, duration, 41)]
    )
    assert off.max() == pytest.approx(HAND_RETREAT_M, abs=1e-9)
    assert off.min() >= -1e-12


@settings(max_examples=50, deadline=None)
@given(placements, placements, st.floats(0.1, 3.0))
def test_a_hand_is_half_retreated_when_its_links_are_measured_against_its_surface(
    start: Placement, end: Placement, duration: float
) -> None:
    curve = SwingCurve(start, end, duration, "point")
    lift = curve.state_at(SWING_SHARE * duration).placement.position_m - start.position_m
    drop = curve.state_at((1.0 - SWING_SHARE) * duration).placement.position_m - end.position_m
    for off, at in ((lift, start), (drop, end)):
        assert off @ at.rotation[:, 2] == pytest.approx(HAND_RETREAT_M / 2, abs=2e-3)


@settings(max_examples=30, deadline=None)
@given(curves)
def test_the_path_is_that_of_the_curve(curve: SwingCurve) -> None:
    shares = np.linspace(0.0, 1.0, 7)
    positions, rotations = curve.poses_at(shares)
    for share, p, R in zip(shares, positions, rotations, strict=True):
        at = curve.state_at(float(share) * curve.duration_s).placement
        np.testing.assert_allclose(p, at.position_m, atol=1e-12)
        np.testing.assert_allclose(R, at.rotation, atol=1e-12)


def test_on_stairs_the_foot_moves_forwards_between_18_and_80_per_cent() -> None:
    curve = SwingCurve(placed((0.0, 0.0, 0.0)), placed((0.3, 0.0, 0.1)), 1.0, "surface")
    x = [curve.state_at(t).placement.position_m[0] for t in (0.18, 0.49, 0.80)]
    np.testing.assert_allclose(x, [0.0, 0.15, 0.3], atol=1e-12)


def test_a_level_step_moves_forwards_between_4_and_96_per_cent() -> None:
    curve = SwingCurve(placed((0.0, 0.0, 0.0)), placed((0.9, 0.0, 0.0)), 1.0, "surface")
    x = [curve.state_at(t).placement.position_m[0] for t in (0.04, 0.5, 0.96)]
    np.testing.assert_allclose(x, [0.0, 0.45, 0.9], atol=1e-12)


def test_a_swing_that_outlasts_a_phase_counts_from_its_lift_off() -> None:
    scenario = stairs_with_rail()
    resting = scenario["phases"][2]
    resting["contacts"] = [c for c in resting["contacts"] if c["effector"] != "right_hand"]
    sequence = sequence_of(scenario, SHAPES)
    for phase in (1, 2):
        curve = swing_of(sequence, "right_hand", phase)
        assert curve.kind == "point"
        assert curve.starts_s == pytest.approx(1.9)
        assert curve.duration_s == pytest.approx(1.8 + 0.4)


def test_swings_of_a_sequence_join_its_contacts() -> None:
    sequence = sequence_of(six_stairs(), SHAPES)
    curve = swing_of(sequence, "right_foot", 5)
    assert curve.start is sequence.phases[4].contacts["right_foot"].placement
    assert curve.end is sequence.phases[6].contacts["right_foot"].placement
    assert (curve.duration_s, curve.kind) == (pytest.approx(1.4), "surface")
    assert curve.starts_s == pytest.approx(sequence.starts_s[5])


@pytest.mark.parametrize(("effector", "phase"), [("left_foot", 1), ("right_hand", 1), ("left_foot", 0)])
def test_refuses_what_does_not_swing(effector: str, phase: int) -> None:
    with pytest.raises(InvalidInput, match=effector) as caught:
        swing_of(sequence_of(flat_walk(), SHAPES), effector, phase)
    assert caught.value.code == "no-swing"


heights = st.floats(0.0, 0.2)
leans = st.floats(-0.3, 0.3)
Lean = tuple[float, float]
SOLE = sole_points_m((0.10, 0.06))


def stone(name: str, x: float, height: float, lean: tuple[float, float]) -> Box:
    """A slab whose upper face has its middle at (x, 0, height)."""
    R = ScipyRotation.from_euler("xy", lean).as_matrix()
    return Box(name, Placement(np.array([x, 0.0, height]) - 0.05 * R[:, 2], R), np.array([0.24, 0.16, 0.10]))


@settings(max_examples=60, deadline=None)
@given(heights, heights, heights, st.tuples(leans, leans), st.tuples(leans, leans), st.floats(0.02, 0.3))
def test_a_sole_passes_over_what_lies_between_its_places(
    z_start: float, z_end: float, z_between: float, lean_start: Lean, lean_end: Lean, width: float
) -> None:
    """Half-way, all of it is clear of every box below its way by the margin; it never enters what lies between."""
    start, end = stone("start", 0.0, z_start, lean_start), stone("end", 0.8, z_end, lean_end)
    first, last = (
        Placement(b.placement.act(np.array([[0.0, 0.0, 0.05]]))[0], b.placement.rotation) for b in (start, end)
    )
    between = Box("between", Placement.from_wxyz([0.4, 0.0, z_between / 2]), np.array([width, 0.4, z_between + 1e-3]))
    terrain = Terrain.from_surfaces([start, between, end])
    rises = required_rise_m(first, last, SOLE, terrain)
    assert rises >= FOOT_CLEARANCE_M
    curve = SwingCurve(first, last, 1.0, "surface", rise_m=rises)
    apex = curve.state_at(0.5).placement.act(SOLE)
    tops = [float(np.nanmax(vertical_span_m(box, apex)[1], initial=-np.inf)) for box in terrain.boxes]
    assert apex[:, 2].min() >= max(tops) + MARGIN_M - 1e-9
    for t in np.linspace(0.0, 1.0, 60):
        assert depth_in_box_m(between, curve.state_at(float(t)).placement.act(SOLE)).max() < 0.0


def test_on_level_ground_a_sole_rises_as_ever() -> None:
    floor = Box("floor", Placement.from_wxyz([0.0, 0.0, -0.1]), np.array([4.0, 4.0, 0.2]))
    assert (
        required_rise_m(placed((0.0, 0.0, 0.0)), placed((0.5, 0.0, 0.0)), SOLE, Terrain.from_surfaces([floor]))
        == FOOT_CLEARANCE_M
    )


def test_neither_a_wall_nor_a_roof_is_stepped_over() -> None:
    wall = Box("wall", Placement.from_wxyz([0.25, 0.0, 0.5]), np.array([0.05, 1.0, 1.0]))
    roof = Box("roof", Placement.from_wxyz([0.25, 0.0, 2.0]), np.array([4.0, 4.0, 0.2]))
    level = placed((0.0, 0.0, 0.0)), placed((0.5, 0.0, 0.0))
    assert required_rise_m(*level, SOLE, Terrain.from_surfaces([wall, roof])) == FOOT_CLEARANCE_M


def test_a_swing_of_a_sequence_knows_what_is_in_its_way() -> None:
    scenario = flat_walk()
    sill = {"name": "sill", "kind": "box", "center_m": [0.125, -0.09, 0.05], "size_m": [0.02, 0.1, 0.1]}
    scenario["terrain"].append(sill)
    curve = swing_of(sequence_of(scenario, SHAPES), "right_foot", 1)
    assert curve.rise_m == pytest.approx(0.1 + MARGIN_M)
    assert swing_of(sequence_of(scenario, SHAPES), "left_foot", 3).rise_m == FOOT_CLEARANCE_M


@pytest.mark.parametrize("height_m", [None, 0.9, 0.56, 0.4, 0.25])
def test_small_robots_lift_their_feet_less(height_m: float | None) -> None:
    """By 0.11 of the height of the CoM, and as high as others an eighth of the swing from either end."""
    shapes = {name: replace(shape, com_height_m=height_m) for name, shape in SHAPES.items() if shape.kind == "surface"}
    scenario = flat_walk(steps=4, step_m=0.1)
    curve = swing_of(sequence_of(scenario, shapes), "right_foot", 1)
    assert curve.rise_m == pytest.approx(0.06 if height_m is None else min(0.06, 0.11 * height_m))
    assert curve.poses_at(np.array([0.5]))[0][0, 2] == pytest.approx(curve.rise_m, abs=2e-3)
    ends_m = curve.poses_at(np.array([0.125, 0.875]))[0][:, 2]
    assert ends_m.min() >= 0.0107
    assert (curve.profile.up == UP) == (curve.rise_m == FOOT_CLEARANCE_M)


def _on_the_beam(x_m: float, y_m: float, yaw_rad: float = 0.0) -> Contact:
    wxyz = (np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2))
    return Contact("left_foot", Placement.from_wxyz([x_m, y_m, 0.0], wxyz), "beam", 0.7, "surface", (0.10, 0.06))


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.8])
def test_a_sole_passes_another_one_on_its_side(side: float, yaw_rad: float) -> None:
    """The rectangles of both soles stay apart across the path, wherever the path leads."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    start, end, other = (
        _on_the_beam(c * x - s * y, s * x + c * y, yaw_rad)
        for x, y in ((-0.3, 0.03 * side), (0.3, 0.03 * side), (0.0, -0.03 * side))
    )
    shift = passing_shift_m(start, end, other)
    aside = side * np.array([-s, c, 0.0])
    assert shift @ aside == pytest.approx(2 * 0.06 + PASSING_GAP_M - 0.06)
    assert np.linalg.norm(shift) == pytest.approx(shift @ aside)
    curve = SwingCurve(start.placement, end.placement, 1.0, "surface", side_m=shift)
    gap = (curve.state_at(0.5).placement.position_m - other.placement.position_m) @ aside
    assert gap == pytest.approx(2 * 0.06 + PASSING_GAP_M)
    for t, contact in ((0.0, start), (1.0, end)):
        state = curve.state_at(t)
        assert np.allclose(state.placement.position_m, contact.placement.position_m)
        assert np.allclose(state.velocity_m_s, 0.0)
        assert np.allclose(state.acceleration_m_s2, 0.0)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((-0.3, 0.2), (0.3, 0.2)),  # wide enough
        ((0.0, 0.3), (0.0, 0.17)),  # aside, towards it
        ((-0.3, 0.03), (-0.25, 0.03)),  # too short
        ((-0.6, 0.03), (-0.3, 0.03)),  # ends before it
    ],
)
def test_a_sole_that_passes_no_other_swings_straight(start: tuple[float, float], end: tuple[float, float]) -> None:
    assert not passing_shift_m(_on_the_beam(*start), _on_the_beam(*end), _on_the_beam(0.0, -0.03)).any()
