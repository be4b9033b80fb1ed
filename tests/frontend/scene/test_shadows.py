"""Shadows of feet lie on the highest surface below each sole, and soles move with their links."""

import numpy as np
import pytest

from stridelab.schemas.scenarios import BoxSurface, Scenario
from stridelab_web.scene.frames import Point, Sheet
from stridelab_web.scene.shadows import LIFT_M, ground_below_m, is_shadow, shadow_points, sole_places_m

STAIR_M = 0.15


def scenario_of(*boxes: BoxSurface) -> Scenario:
    """A scenario of one phase in which the left foot stands at (0.1, 0.2, 0)."""
    contact = {"effector": "left_foot", "position_m": (0.1, 0.2, 0.0), "orientation_wxyz": (1.0, 0.0, 0.0, 0.0)}
    phases = [{"duration_s": 1.0, "contacts": [contact, contact | {"effector": "left_hand"}]}]
    terrain = [box.model_dump() for box in boxes]
    return Scenario.model_validate({"name": "one", "robot": "talos", "terrain": terrain, "phases": phases})


def make_box(name: str, center_m: tuple[float, float, float], size_m: tuple[float, float, float]) -> BoxSurface:
    return BoxSurface(name=name, kind="box", center_m=center_m, size_m=size_m)


GROUND = make_box("ground", (0.0, 0.0, -0.5), (4.0, 4.0, 1.0))
STAIR = make_box("stair", (1.0, 0.0, STAIR_M / 2), (1.0, 4.0, STAIR_M))


@pytest.mark.parametrize(
    ("place_m", "ground_m"),
    [
        ((0.0, 0.0, 0.1), 0.0),
        ((1.0, 0.0, 0.3), STAIR_M),
        ((1.0, 0.0, STAIR_M - 0.01), STAIR_M),
        ((1.0, 0.0, 0.05), 0.0),
        ((5.0, 0.0, 0.1), np.nan),
    ],
    ids=["ground", "over a stair", "a little sunk", "a stair beside the foot", "nothing below"],
)
def test_the_ground_below_a_place(place_m: tuple[float, float, float], ground_m: float) -> None:
    for order in ((GROUND, STAIR), (STAIR, GROUND)):
        np.testing.assert_allclose(ground_below_m(scenario_of(*order), np.array([place_m])), [ground_m], atol=1e-9)


def test_a_ramp_is_higher_uphill_and_a_wall_holds_no_shadow() -> None:
    half = np.radians(10.0) / 2
    ramp = GROUND.model_copy(update={"orientation_wxyz": (float(np.cos(half)), 0.0, float(-np.sin(half)), 0.0)})
    ahead_m = ground_below_m(scenario_of(ramp), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0]]))
    assert ahead_m[1] - ahead_m[0] == pytest.approx(np.tan(np.radians(10.0)), abs=1e-9)
    upright = GROUND.model_copy(update={"orientation_wxyz": (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)})
    assert np.isnan(ground_below_m(scenario_of(upright), np.array([[0.0, 0.0, 3.0]]))).all()


def test_a_sole_moves_with_the_nearest_link() -> None:
    turned = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    ankle = [(0.05, 0.2, 0.1, 1.0, 0.0, 0.0, 0.0), (1.05, 0.2, 0.3, *turned)]
    head = [(0.0, 0.0, 1.7, 1.0, 0.0, 0.0, 0.0)] * 2
    places_m = sole_places_m(scenario_of(GROUND), np.stack([head, ankle], axis=1))
    assert places_m.keys() == {"left_foot"}
    np.testing.assert_allclose(places_m["left_foot"], [[0.1, 0.2, 0.0], [1.05, 0.25, 0.2]], atol=1e-12)


def test_a_shadow_is_below_the_foot_a_little_above_the_ground() -> None:
    sheet = Sheet()
    (shadow,) = shadow_points(sheet, "/body/", {"l": np.array([[1.0, 2.0, 0.4]])}, {"l": np.array([0.15])})
    assert is_shadow(shadow)
    assert not is_shadow(Point("/body/foot/l", 0, ""))
    assert (shadow.name, shadow.label) == ("/body/shadow/l", "")
    np.testing.assert_allclose(sheet.to_array(1), [[1.0, 2.0, 0.15 + LIFT_M]], atol=1e-6)
