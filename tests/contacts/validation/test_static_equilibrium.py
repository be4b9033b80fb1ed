"""How well the contacts of a phase hold the CoM still, against linear programmes and by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from stridelab.contacts.effector_geometry import EffectorReach, EffectorShape
from stridelab.contacts.validation.parse import parse_scenario
from stridelab.contacts.validation.reach_slack import ACCURACY_M, check_reach, reach_set
from stridelab.contacts.validation.static_equilibrium import StaticEquilibrium, static_equilibria
from stridelab.contacts.validation.surface_contact import Stance, contacts_on_surfaces
from stridelab.contacts.validation.validate import ValidationReport, validate_scenario
from stridelab.machine.models_folder import models_dir
from support.robots.scenario_bodies import FOOT_REACH, SHAPES, Made

FLOOR = {"name": "floor", "kind": "box", "center_m": [0.0, 0.0, -0.5], "size_m": [8.0, 8.0, 1.0]}
WALLS = [
    {"name": f"wall {k}", "kind": "box", "center_m": [0.0, y, 1.0], "size_m": [2.0, 1.0, 4.0]}
    for k, y in enumerate((1.0, -1.0))
]
RIGHT, UP, LEFT = (0.0, -1.0), (0.0, 0.0), (0.0, 1.0)


def stood(contacts: list[Made], shapes: dict[str, EffectorShape], terrain: list[Made] | None = None) -> list[Stance]:
    phases = [{"duration_s": 1.0, "contacts": contacts}]
    scenario = {"name": "any", "robot": "talos", "friction": 0.6, "terrain": terrain or [FLOOR], "phases": phases}
    return list(contacts_on_surfaces(parse_scenario(scenario, shapes), shapes))


def rested(stances: list[Stance]) -> list[StaticEquilibrium]:
    return list(static_equilibria(stances, check_reach(tuple(stances)).slacks))


def foot(name: str, x: float, y: float) -> Made:
    return {"effector": name, "position_m": [x, y, 0.0]}


def test_one_foot_holds_half_its_width() -> None:
    (rest,) = rested(stood([foot("left_foot", 0.3, 0.2)], dict(SHAPES)))
    x, y = SHAPES["left_foot"].half_size_m or (0.0, 0.0)
    corners = sorted((0.3 + i * x, 0.2 + j * y) for i in (-1, 1) for j in (-1, 1))
    np.testing.assert_allclose(sorted(np.round(rest.region_m, 9).tolist()), corners, atol=1e-9)
    assert rest.margin_m == pytest.approx(min(x, y), abs=ACCURACY_M)
    assert rest.com_m is not None
    assert rest.com_m[1] == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize(("usual", "high"), [(0.8, 0.8), (1.5, 1.0), (-1.0, -0.1), (None, None)])
def test_the_com_is_shown_as_high_as_robots_stand(usual: float | None, high: float | None) -> None:
    """Within reach: from -0.1 to 1.0 m above the foot."""
    shapes = {**SHAPES, "left_foot": replace(SHAPES["left_foot"], com_height_m=usual)}
    (rest,) = rested(stood([foot("left_foot", 0.3, 0.2)], shapes))
    (other,) = rested(stood([foot("left_foot", 0.3, 0.2)], dict(SHAPES)))
    assert rest.com_m is not None
    assert other.com_m is not None
    assert rest.com_m[2] == pytest.approx(other.com_m[2] if high is None else high, abs=1e-9)
    np.testing.assert_array_equal(rest.com_m[:2], other.com_m[:2])
    assert rest.margin_m == other.margin_m


def test_a_com_that_does_not_come_over_its_foot_only_passes() -> None:
    """The reach allows it no farther to the left than 0.1 m right of the foot, whose edge is at -0.06 m."""
    aside = replace(SHAPES["left_foot"], reach=EffectorReach((-0.5, -0.4, 0.6), (0.5, -0.1, 1.0), 2.0))
    (rest,) = rested(stood([foot("left_foot", 0.0, 0.0)], {**SHAPES, "left_foot": aside}))
    assert rest.margin_m == pytest.approx(-0.04, abs=ACCURACY_M)
    assert rest.com_m is not None
    assert rest.com_m[1] == pytest.approx(-0.1, abs=1e-3)


def test_a_motion_neither_begins_nor_ends_where_nothing_holds_it_still() -> None:
    """The left foot alone holds no CoM at rest: a fault at the ends, a remark between."""
    aside = replace(SHAPES["left_foot"], reach=EffectorReach((-0.5, -0.4, 0.6), (0.5, -0.1, 1.0), 2.0))
    shapes = {**SHAPES, "left_foot": aside}
    left, right = foot("left_foot", 0.0, 0.1), foot("right_foot", 0.0, -0.1)

    def report(*phases: list[Made]) -> ValidationReport:
        timed = [{"duration_s": 1.0, "contacts": contacts} for contacts in phases]
        scenario = {"name": "any", "robot": "talos", "friction": 0.6, "terrain": [FLOOR], "phases": timed}
        return validate_scenario(scenario, shapes)

    assert report([left, right], [right], [left, right]).valid
    between = report([left, right], [left], [left, right])
    assert between.valid
    assert [(remark.code, "phase 1" in remark.message) for remark in between.remarks] == [("passed-in-motion", True)]
    assert [fault.where for fault in report([left, right], [left]).faults] == ["phases[1]"]
    assert next(fault.where for fault in report([left], [left, right]).faults) == "phases[0]"
    (alone,) = report([left]).faults
    assert "begins and ends here at rest" in alone.message


def test_without_a_known_reach_there_is_a_region_alone() -> None:
    nothing = {name: replace(shape, reach=None) for name, shape in SHAPES.items()}
    (rest,) = rested(stood([foot("left_foot", 0.0, 0.1), foot("right_foot", 0.2, -0.1)], nothing))
    assert len(rest.region_m) == 6
    assert (rest.margin_m, rest.com_m) == (None, None)


def test_nothing_holds_without_contacts() -> None:
    (rest,) = rested(stood([], dict(SHAPES)))
    assert rest.region_m == ()
    assert rest.margin_m is None


def test_hands_that_squeeze_leave_the_region_of_the_soles() -> None:
    """Two hands between walls can press against each other without end: their cone has no section."""
    hands = [
        {"effector": "left_hand", "position_m": [0.0, 0.5, 1.0], "orientation_wxyz": [0.5**0.5, 0.5**0.5, 0.0, 0.0]},
        {
            "effector": "right_hand",
            "position_m": [0.0, -0.5, 1.0],
            "orientation_wxyz": [0.5**0.5, -(0.5**0.5), 0.0, 0.0],
        },
    ]
    feet = [foot("left_foot", 0.0, 0.1), foot("right_foot", 0.0, -0.1)]
    shapes = {**SHAPES, "left_hand": SHAPES["right_hand"]}
    (both,) = rested(stood([*feet, *hands], shapes, [FLOOR, *WALLS]))
    (alone,) = rested(stood(feet, shapes))
    assert both.region_m == alone.region_m


def test_the_bundled_climbs_against_a_linear_programme() -> None:
    """Spheres of reach taken away, each phase is a linear programme in (c, r)."""
    compared = 0
    for name in ("six-stairs", "stairs-with-rail"):
        scenario = json.loads((models_dir() / "scenarios" / f"{name}.json").read_text(encoding="utf-8"))
        boxes = {
            key: replace(shape, reach=replace(shape.reach or FOOT_REACH, com_distance_max_m=20.0))
            for key, shape in SHAPES.items()
        }
        stances = contacts_on_surfaces(parse_scenario(scenario, boxes), boxes)
        result = static_equilibria(stances, check_reach(stances).slacks)
        for stance, rest in zip(stances, result, strict=True):
            corners = np.array(rest.region_m)
            edge = np.roll(corners, -1, axis=0) - corners
            normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1, keepdims=True)
            rows = [[*n, 0.0, 1.0] for n in normal]
            bounds = list(np.einsum("ij,ij->i", normal, corners))
            for at, reach in reach_set(list(stance.values())):
                for axis, low, high in zip(at.rotation.T, reach.com_low_m, reach.com_high_m, strict=True):
                    rows += [[*axis, 0.0], [*-axis, 0.0]]
                    bounds += [float(axis @ at.position_m) + high, -float(axis @ at.position_m) - low]
            truth = linprog([0.0, 0.0, 0.0, -1.0], A_ub=rows, b_ub=bounds, bounds=(None, None))
            assert rest.margin_m == pytest.approx(-truth.fun, abs=2 * ACCURACY_M)
            compared += 1
    assert compared == 56
