"""Scenarios as touches and as pictures."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from stridelab.schemas.scenarios import BoxSurface, RailSurface, Scenario, ScenarioContact, ScenarioPhase
from stridelab_web.charts import scenario_drawing
from stridelab_web.charts.scenario_drawing import PX_PER_M, draw_scenario
from stridelab_web.pages.plans.plots import in_the_air_s, plan_curves
from stridelab_web.scene.contacts import box_corners_m, placed_contacts, rotation_matrix


def at(effector: str, x: float, z: float = 0.0) -> ScenarioContact:
    return ScenarioContact(effector=effector, position_m=(x, 0.1 if "left" in effector else -0.1, z))


@pytest.fixture
def steps() -> Scenario:
    """Right foot, then left foot forward, and back onto the same place with the right one."""
    left, right, right_ahead, left_ahead = (
        at("left_foot", 0.0), at("right_foot", 0.0), at("right_foot", 0.3), at("left_foot", 0.6, 0.1),
    )  # fmt: skip
    contacts = [[left, right], [left], [left, right_ahead], [right_ahead], [right_ahead, left_ahead]]
    phases = [ScenarioPhase(duration_s=0.5 + k, contacts=now) for k, now in enumerate(contacts)]
    terrain = [
        BoxSurface(name="ground", kind="box", center_m=(0.0, 0.0, -0.5), size_m=(20.0, 20.0, 1.0)),
        BoxSurface(name="step", kind="box", center_m=(0.7, 0.0, 0.05), size_m=(0.4, 1.0, 0.1)),
        RailSurface(name="rail", kind="rail", from_m=(0.0, -0.5, 0.8), to_m=(1.0, -0.5, 1.3), radius_m=0.02),
    ]
    return Scenario(name="two steps", robot="talos", terrain=terrain, phases=phases)


def test_a_touch_lasts_as_long_as_the_effector_stays(steps: Scenario) -> None:
    result = [(t.number, t.effector, t.first_phase, t.last_phase, t.start_s, t.end_s) for t in placed_contacts(steps)]
    assert result == [
        (1, "left_foot", 0, 2, 0.0, 4.5),
        (2, "right_foot", 0, 0, 0.0, 0.5),
        (3, "right_foot", 2, 4, 2.0, 12.5),
        (4, "left_foot", 4, 4, 8.0, 12.5),
    ]


def test_a_foot_that_comes_back_to_the_same_place_touches_twice() -> None:
    both = [at("left_foot", 0.0), at("right_foot", 0.0)]
    phases = [ScenarioPhase(duration_s=1.0, contacts=now) for now in (both, both[:1], both)]
    again = Scenario(name="tap", robot="talos", terrain=[], phases=phases)
    assert [(t.effector, t.first_phase, t.last_phase) for t in placed_contacts(again)] == [
        ("left_foot", 0, 2),
        ("right_foot", 0, 0),
        ("right_foot", 2, 2),
    ]


def test_rotations_and_corners_are_those_of_scipy() -> None:
    rng = np.random.default_rng(0)
    for wxyz in rng.normal(size=(20, 4)):
        w, x, y, z = wxyz.tolist()
        assert np.allclose(rotation_matrix((w, x, y, z)), Rotation.from_quat([x, y, z, w]).as_matrix(), atol=1e-12)
    box = BoxSurface(name="b", kind="box", center_m=(1.0, 2.0, 3.0), size_m=(2.0, 4.0, 6.0), yaw_rad=np.pi / 2)
    corners = box_corners_m(box)
    assert corners.shape == (8, 3)
    assert np.allclose(corners.min(axis=0), [-1.0, 1.0, 0.0])
    assert np.allclose(corners.max(axis=0), [3.0, 3.0, 6.0])
    assert np.array_equal(rotation_matrix((0.0, 0.0, 0.0, 0.0)), np.eye(3))


def test_a_picture_shows_every_touch_in_its_place(steps: Scenario) -> None:
    for view, up in (("side", 2), ("above", 1)):
        picture = draw_scenario(steps, view)
        assert picture is not None
        numbered = {shape.text: shape for shape in picture.shapes if shape.text}
        assert set(numbered) == {"1", "2", "3", "4"}
        first, last = numbered["1"], numbered["4"]
        assert last.x - first.x == pytest.approx(0.6 * PX_PER_M, abs=0.2), "x grows to the right"
        places = {t.number: t.contact.position_m for t in placed_contacts(steps)}
        assert first.y - last.y == pytest.approx((places[4][up] - places[1][up]) * PX_PER_M, abs=0.2), "up is up"
        for shape in picture.shapes:
            assert all(np.isfinite(float(v)) for pair in shape.points.split() for v in pair.split(","))
        for shape in numbered.values():
            assert 0 < shape.x < picture.width
            assert 0 < shape.y < picture.height
        assert picture.width < 3 * PX_PER_M, "a wide floor does not make the robot small"


def test_nothing_to_draw_is_not_a_picture() -> None:
    assert draw_scenario(Scenario(name="none", robot="talos", terrain=[], phases=[]), "side") is None


def test_plots_of_a_plan_add_up_the_corners_and_shade_steps(steps: Scenario) -> None:
    assert in_the_air_s(steps) == [(0.5, 2.0), (4.5, 8.0)]
    time_s = np.array([0.0, 1.0, 2.0])
    columns = {"time_s": time_s, "com_x_m": time_s, "l_z_nms": np.full(3, np.nan)}
    columns |= {f"f_left_foot_{k}_z_n": np.array([10.0 * k, np.nan, 1.0]) for k in range(4)}
    drawn = plan_curves(columns, steps)
    assert drawn["columns"]["left_foot_fz_n"] == [60.0, 0.0, 4.0]
    assert [row["title"] for row in drawn["rows"]] == ["CoM x [m]", "Vertical force [N]"]
    assert drawn["shades_s"] == [[0.5, 2.0], [4.5, 8.0]]


def test_the_outline_is_the_convex_hull() -> None:
    rng = np.random.default_rng(0)
    for n in (3, 4, 8, 30):
        points = rng.standard_normal((n, 2))
        hull = points[ConvexHull(points).vertices]
        assert {tuple(p) for p in scenario_drawing._convex_outline(points)} == {tuple(p) for p in hull}
    line = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]])
    assert np.array_equal(scenario_drawing._convex_outline(line), line)
