"""A dragged patch stays on its tread and off what stands there; a hand stays on its rail."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stridelab.schemas.scenarios import BoxSurface, RailSurface, Scenario, ScenarioContact, ScenarioPhase
from stridelab_web.scene.contacts import PlacedContact, placed_contacts, rotation_matrix
from stridelab_web.viewer.foothold_constraints import RailAxis, Tread, guide_of
from support.fakes import robots

HALF = robots.HALF_M
SCENARIO = robots.scenario()
metres = st.floats(-1.5, 1.5)
angles = st.floats(-math.pi, math.pi)


def foot(x: float, y: float, z: float, yaw: float = 0.0) -> PlacedContact:
    wxyz = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    contact = ScenarioContact(effector="left_foot", position_m=(x, y, z), orientation_wxyz=wxyz)
    return PlacedContact(1, "left_foot", 0, 0, 0.0, 1.0, contact)


def keep(
    guide: Tread | RailAxis, touch: PlacedContact, wanted: np.ndarray, half: tuple[float, float] = HALF
) -> np.ndarray | None:
    return guide.constrain_position(touch, half, np.array(touch.contact.position_m), wanted)


def corners(touch: PlacedContact, at: np.ndarray) -> np.ndarray:
    own = np.array([[sx * HALF[0], sy * HALF[1], 0.0] for sx in (-1, 1) for sy in (-1, 1)])
    return np.asarray(at + own @ rotation_matrix(touch.contact.orientation_wxyz).T)


def tread_of(touch: PlacedContact, scenario: Scenario = SCENARIO) -> Tread:
    guide = guide_of(scenario, touch)
    assert isinstance(guide, Tread)
    return guide


def test_every_contact_finds_what_it_slides_on() -> None:
    kinds = [type(guide_of(SCENARIO, touch)).__name__ for touch in placed_contacts(SCENARIO)]
    assert kinds == ["Tread", "Tread", "RailAxis", "Tread", "Tread", "Tread", "Tread"]
    assert guide_of(SCENARIO, foot(0.3, 0.0, 0.5)) is None


@given(x=metres, y=metres, yaw=angles)
@settings(max_examples=150, deadline=None)
def test_the_patch_stays_on_the_step_and_out_of_the_next_one(x: float, y: float, yaw: float) -> None:
    touch = foot(0.25, 0.0, 0.1, yaw)
    moved = keep(tread_of(touch), touch, np.array([x, y, 0.1]))
    assert moved is not None
    placed = corners(touch, moved)
    # the first step is open from 0.145 to the second one at 0.445, and 1.2 m wide; it is wide enough for any yaw
    assert placed[:, 0].min() > 0.145 - 1e-9
    assert placed[:, 0].max() < 0.445 + 1e-6
    assert np.abs(placed[:, 1]).max() < 0.6 + 1e-9
    assert moved[2] == 0.1


@given(x=st.floats(0.62, 1.2), y=st.floats(-0.45, 0.45), yaw=angles)
@settings(max_examples=60, deadline=None)
def test_where_there_is_room_nothing_is_moved(x: float, y: float, yaw: float) -> None:
    touch = foot(0.8, 0.0, 0.2, yaw)
    wanted = np.array([x, y, 0.2])
    moved = keep(tread_of(touch), touch, wanted)
    assert moved is not None
    assert np.abs(moved - wanted).max() < 1e-12


def test_a_patch_goes_round_a_post_but_not_through_it() -> None:
    floor = BoxSurface(name="floor", kind="box", center_m=(0.0, 0.0, -0.05), size_m=(2.0, 2.0, 0.1))
    post = BoxSurface(name="post", kind="box", center_m=(0.0, 0.0, 0.5), size_m=(0.2, 0.2, 1.0))
    scenario = SCENARIO.model_copy(update={"terrain": [floor, post]})
    touch = foot(-0.5, 0.0, 0.0)
    tread = tread_of(touch, scenario)
    at = np.array(touch.contact.position_m)
    # straight on it stops before the post, wherever behind it the pointer is
    for x in (-0.1, 0.0, 0.1, 0.15):
        assert keep(tread, touch, np.array([x, 0.01, 0.0])) == pytest.approx((-0.2, 0.01, 0.0))
    for wanted in ((-0.3, 0.3, 0.0), (0.0, 0.3, 0.0), (0.4, 0.0, 0.0)):
        there = tread.constrain_position(touch, HALF, at, np.array(wanted))
        assert there is not None
        at = there
    assert at == pytest.approx((0.4, 0.0, 0.0))


@given(x=metres, y=metres, slope=st.floats(-0.4, 0.4), yaw=angles)
@settings(max_examples=60, deadline=None)
def test_on_a_slope_the_patch_stays_in_its_plane(x: float, y: float, slope: float, yaw: float) -> None:
    tilt = (math.cos(slope / 2), 0.0, math.sin(slope / 2), 0.0)
    ramp = BoxSurface(name="ramp", kind="box", center_m=(0.0, 0.0, 0.0), size_m=(1.0, 0.8, 0.2), orientation_wxyz=tilt)
    R = rotation_matrix(tilt)
    top = 0.1 * R[:, 2]
    contact = ScenarioContact(effector="left_foot", position_m=tuple(top.tolist()), orientation_wxyz=tilt)
    scenario = SCENARIO.model_copy(
        update={"terrain": [ramp], "phases": [ScenarioPhase(duration_s=1.0, contacts=[contact])]}
    )
    touch = placed_contacts(scenario)[0]
    tread = tread_of(touch, scenario)
    eye = np.array([-1.0, -2.0, 2.0])
    target = top + R @ [x / 4, y / 4, 0.0]
    hit = tread.ray_intersection(eye, eye + 0.3 * (target - eye))
    assert hit is not None
    assert np.abs(hit - target).max() < 1e-9
    moved = keep(tread, touch, hit)
    assert moved is not None
    own = (corners(touch, moved) - top) @ R
    assert np.abs(own[:, 2]).max() < 1e-9
    assert (np.abs(own[:, :2]) <= np.array([0.5, 0.4]) + 1e-9).all()


def test_a_ray_that_leads_away_meets_nothing() -> None:
    tread = tread_of(foot(0.0, 0.0, 0.0))
    assert tread.ray_intersection(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 2.0])) is None
    assert tread.ray_intersection(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0])) is None


def test_a_patch_wider_than_the_room_left_has_no_place() -> None:
    low = BoxSurface(name="low", kind="box", center_m=(0.0, 0.0, -0.05), size_m=(1.0, 1.0, 0.1))
    high = BoxSurface(name="high", kind="box", center_m=(0.0, 0.0, 0.05), size_m=(0.9, 0.9, 0.1))
    scenario = SCENARIO.model_copy(update={"terrain": [low, high]})
    touch = foot(0.47, 0.0, 0.0)
    tread = guide_of(scenario, touch)
    assert isinstance(tread, Tread)
    assert keep(tread, touch, np.array([0.47, 0.0, 0.0])) is None


@given(x=metres, s=st.floats(-1.0, 2.0))
@settings(max_examples=60, deadline=None)
def test_a_hand_slides_along_its_rail_and_no_farther(x: float, s: float) -> None:
    rail = RailSurface(name="rail", kind="rail", from_m=(0.0, -0.5, 0.6), to_m=(1.2, -0.5, 1.2), radius_m=0.02)
    along = np.array([2.0, 0.0, 1.0]) / math.sqrt(5)
    normal = np.array([-1.0, 0.0, 2.0]) / math.sqrt(5)
    start = np.array(rail.from_m)
    place = start + 0.4 * along + 0.02 * normal
    contact = ScenarioContact(effector="right_hand", position_m=tuple(place.tolist()))
    scenario = SCENARIO.model_copy(update={"terrain": [rail]})
    touch = PlacedContact(1, "right_hand", 0, 0, 0.0, 1.0, contact)
    bar = guide_of(scenario, touch)
    assert isinstance(bar, RailAxis)
    eye = np.array([x, -3.0, 1.5])
    hit = bar.ray_intersection(eye, start + s * along)  # the ray passes through the axis itself
    assert hit is not None
    assert np.abs(hit - (start + s * along)).max() < 1e-6
    moved = keep(bar, touch, hit, (0.0, 0.0))
    assert moved is not None
    expected = start + np.clip(s, 0.0, bar.length_m) * along + 0.02 * normal
    assert np.abs(moved - expected).max() < 1e-6
