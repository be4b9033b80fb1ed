"""What the judge of scenarios says of values, phases and the whole, and that nothing makes it fall over."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios.stairs import Stairs, flat_walk, six_stairs, stairs_with_rail
from stridelab.contacts.validation.validate import (
    ValidationReport,
    validate_and_build,
    validate_quickly,
    validate_scenario,
)
from stridelab.machine.models_folder import models_dir
from stridelab.schemas.scenarios import Scenario, ScenarioCheck
from support.robots.scenario_bodies import SHAPES, Made, contact, faults, judged


@pytest.mark.parametrize("duration_s", [0.0, -1.0, 0.049, 60.1, math.nan, math.inf, None, "long"], ids=str)
def test_durations(duration_s: Any) -> None:
    def change(s: Made) -> None:
        s["phases"][3]["duration_s"] = duration_s

    report = judged(six_stairs(), change)
    assert [where for where, _ in faults(report)] == ["phases[3].duration_s"]
    assert math.isfinite(report.duration_s)


@pytest.mark.parametrize(
    ("quaternion", "word"),
    [([0.0, 0.0, 0.0, 0.0], "zero"), ([math.nan, 0.0, 0.0, 1.0], "finite"), ([1.0, 0.0, 0.0], "four")],
)
def test_quaternions(quaternion: list[float], word: str) -> None:
    report = judged(six_stairs(), lambda s: contact(s, 2, "left_foot").update(orientation_wxyz=quaternion))
    ((where, message),) = faults(report)
    assert where == "phases[2].contacts[left_foot]"
    assert word in message


@pytest.mark.parametrize(("position", "word"), [([0.0, 0.0], "three"), ([0.0, math.inf, 0.0], "finite")])
def test_positions(position: list[float], word: str) -> None:
    report = judged(six_stairs(), lambda s: contact(s, 2, "left_foot").update(position_m=position))
    ((where, message),) = faults(report)
    assert where == "phases[2].contacts[left_foot]"
    assert word in message


def test_unknown_effector() -> None:
    report = judged(six_stairs(), lambda s: contact(s, 4, "right_foot").update(effector="tail"))
    assert report.faults[0].where == "phases[4].contacts[tail]"
    assert "left_foot, right_foot" in report.faults[0].message


def test_the_same_effector_twice() -> None:
    report = judged(six_stairs(), lambda s: contact(s, 4, "right_foot").update(effector="left_foot"))
    assert ("phases[4].contacts[left_foot]", "the same effector is named twice") in faults(report)


@pytest.mark.parametrize(
    ("change", "where", "word"),
    [
        ({"size_m": [1.0, 0.0, 1.0]}, "terrain[1]", "above 0"),
        ({"size_m": [1.0, -2.0, 1.0]}, "terrain[1]", "above 0"),
        ({"orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}, "terrain[1]", "not by both"),
        ({"name": "ground"}, "terrain[1].name", "two surfaces"),
        ({"friction": -0.1}, "terrain[1]", "friction"),
        ({"kind": "ball"}, "terrain[1]", "'ball'"),
        ({"center_m": [0.0, 0.0, math.nan]}, "terrain[1]", "finite"),
    ],
)
def test_surfaces(change: Made, where: str, word: str) -> None:
    report = judged(six_stairs(), lambda s: s["terrain"][1].update(change))
    result = dict(faults(report))
    assert word in result[where]


@pytest.mark.parametrize(("change", "word"), [("from_m", "no length"), ("radius_m", "above 0")])
def test_rails(change: str, word: str) -> None:
    def spoil(s: Made) -> None:
        rail = s["terrain"][-1]
        rail[change] = rail["to_m"] if change == "from_m" else 0.0

    assert word in dict(faults(judged(stairs_with_rail(), spoil)))["terrain[5]"]


@pytest.mark.parametrize("missing", ["duration_s", "contacts"])
def test_missing_fields_of_a_phase(missing: str) -> None:
    def change(s: Made) -> None:
        del s["phases"][2][missing]

    assert judged(six_stairs(), change).faults[0].where.startswith("phases[2]")


def test_things_that_are_no_scenario() -> None:
    assert validate_scenario({}, SHAPES).faults[0].where == "phases"
    strange: Made = {"terrain": [None, 3], "phases": [None, {"duration_s": 1.0, "contacts": [7, {}]}], "friction": "no"}
    wheres = {fault.where for fault in validate_scenario(strange, SHAPES).faults}
    assert {"friction", "terrain[0]", "terrain[1]", "phases[0].duration_s", "phases[1].contacts[0]"} <= wheres


def test_no_phases() -> None:
    assert faults(judged(flat_walk(), lambda s: s["phases"].clear())) == [("phases", "there are no phases")]


def test_too_many_phases_and_too_long_a_motion() -> None:
    many = judged(flat_walk(), lambda s: s.update(phases=s["phases"] * 24))
    assert "at most 400" in faults(many)[0][1]
    long = judged(flat_walk(), lambda s: [p.update(duration_s=50.0) for p in s["phases"]])
    assert "850 s" in faults(long)[0][1]


def test_too_many_surfaces() -> None:
    def change(s: Made) -> None:
        s["terrain"] += [s["terrain"][0] | {"name": f"tile {i}"} for i in range(200)]

    assert faults(judged(flat_walk(), change)) == [("terrain", "201 surfaces; at most 200 can be checked")]


def test_a_phase_in_flight() -> None:
    report = judged(flat_walk(), lambda s: s["phases"][3]["contacts"].clear())
    assert ("phases[3]", "no contacts in this phase: flight is not supported") in faults(report)


def test_a_phase_on_a_hand_alone() -> None:
    def change(s: Made) -> None:
        s["phases"][3]["contacts"] = [contact(s, 3, "right_hand")]

    assert "hands alone" in dict(faults(judged(stairs_with_rail(), change)))["phases[3]"]


def test_feet_that_change_places_in_one_instant() -> None:
    def change(s: Made) -> None:
        del s["phases"][2]

    result = dict(faults(judged(flat_walk(), change)))
    assert "left_foot lift off at the moment" in result["phases[2].contacts[right_foot]"]


def test_a_foot_that_slides() -> None:
    def change(s: Made) -> None:
        del s["phases"][1]

    result = dict(faults(judged(flat_walk(), change)))
    assert result["phases[1].contacts[right_foot]"].startswith("slides 0.25 m")


def test_a_foot_that_turns_on_the_spot() -> None:
    half = math.radians(10.0) / 2
    turned = [math.cos(half), 0.0, 0.0, math.sin(half)]
    report = judged(flat_walk(), lambda s: contact(s, 0, "left_foot").update(orientation_wxyz=turned))
    assert faults(report)[0][0] == "phases[1].contacts[left_foot]"
    assert "slides" in faults(report)[0][1]


def test_a_foot_from_nowhere() -> None:
    def change(s: Made) -> None:
        s["phases"][0]["contacts"] = [contact(s, 0, "left_foot")]

    assert "without an earlier contact" in dict(faults(judged(flat_walk(), change)))["phases[2].contacts[right_foot]"]


def test_a_hand_may_come_later() -> None:
    def change(s: Made) -> None:
        s["phases"][0]["contacts"] = [c for c in s["phases"][0]["contacts"] if c["effector"] != "right_hand"]

    report = judged(stairs_with_rail(), change)
    assert report.valid
    assert [remark.code for remark in report.remarks] == ["hand-comes-late"]


@pytest.mark.parametrize("friction", [0.0, -0.3, math.nan, 2.1])
def test_a_surface_without_friction_names_who_stands_on_it_first(friction: float) -> None:
    result = dict(faults(judged(six_stairs(), lambda s: s["terrain"][2].update(friction=friction))))
    assert list(result) == ["terrain[2]", "phases[6].contacts[right_foot]"]
    assert "friction" in result["terrain[2]"]
    assert "'stair 2'" in result["phases[6].contacts[right_foot]"]


@pytest.mark.parametrize("friction", [0.0, -0.3, math.nan])
def test_a_scenario_without_friction_names_who_stands_on_it_first(friction: float) -> None:
    def change(s: Made) -> None:
        s["terrain"][0]["friction"] = 0.4
        s["friction"] = friction

    wheres = [where for where, _ in faults(judged(six_stairs(), change))]
    assert wheres == ["friction", "phases[2].contacts[right_foot]"]


def test_a_stair_of_150_metres_is_a_mistake_of_units() -> None:
    result = dict(faults(validate_scenario(six_stairs(Stairs(1, 150.0)), SHAPES)))
    assert list(result)[:2] == ["terrain[1]", "phases[2].contacts[right_foot]"]
    assert all("lengths are in metres" in message for message in result.values())


def test_a_stair_of_fifteen_metres_is_refused_with_its_units() -> None:
    (fault,) = validate_scenario(six_stairs(Stairs(1, 15.0)), SHAPES).faults
    assert fault.where == "phases[2].contacts[right_foot]"
    assert "are all lengths in metres?" in fault.message


@pytest.mark.parametrize("height_m", [0.0, -0.5, 3.1, math.nan, "low"], ids=str)
def test_a_start_at_no_height(height_m: Any) -> None:
    result = faults(judged(flat_walk(), lambda s: s.update(start_com_height_m=height_m)))
    assert [where for where, _ in result] == ["start_com_height_m"]


def test_five_hundred_phases() -> None:
    report = judged(flat_walk(), lambda s: s.update(phases=s["phases"][:1] * 500))
    assert faults(report) == [("phases", "500 phases; at most 400 can be planned")]


def test_a_hand_in_a_box_beside_its_rail() -> None:
    def change(s: Made) -> None:
        s["terrain"].append({"name": "post", "kind": "box", "center_m": [-0.08, -0.58, 0.5], "size_m": [0.1, 0.1, 1.0]})

    assert "is inside 'post'" in dict(faults(judged(stairs_with_rail(), change)))["phases[0].contacts[right_hand]"]


def test_margins_and_support_regions() -> None:
    report = validate_scenario(six_stairs(), SHAPES)
    assert len(report.rests) == 25
    first = report.margins[0]
    assert (first.phase, first.effector, first.surface) == (0, "left_foot", "ground")
    assert first.height_m == pytest.approx(0.0, abs=1e-9)
    assert {round(m.edge_m or 0.0, 3) for m in report.margins if m.surface == "stair 2"} == {0.04}
    corners = [(-0.1, 0.03), (-0.1, 0.15), (0.1, 0.03), (0.1, 0.15)]
    np.testing.assert_allclose(sorted(report.rests[1].region_m), corners, atol=1e-12)
    polygon = np.array(report.rests[0].region_m)
    area = 0.5 * np.sum(polygon[:, 0] * np.roll(polygon[:, 1], -1) - polygon[:, 1] * np.roll(polygon[:, 0], -1))
    assert area == pytest.approx(0.2 * 0.3)
    assert report.rests[0].margin_m == pytest.approx(0.1, abs=1e-3)  # half a sole's length
    assert report.rests[1].margin_m == pytest.approx(0.06, abs=1e-3)  # half its width
    assert report.duration_s == pytest.approx(24.0)


def test_faults_come_in_the_order_of_the_phases() -> None:
    def change(s: Made) -> None:
        s["phases"][9]["duration_s"] = 0.0
        s["phases"][3]["contacts"].clear()
        s["terrain"][1]["size_m"] = [0.0, 0.0, 0.0]

    wheres = [where for where, _ in faults(judged(six_stairs(), change))]
    assert wheres[0] == "terrain[1]"
    assert wheres.index("phases[3]") < wheres.index("phases[9].duration_s")


metres = st.one_of(st.floats(-100.0, 100.0), st.sampled_from([0.0, 0.1, -0.09, 0.3, 1e-9]))
positions = st.tuples(metres, metres, metres)
parts = st.one_of(st.floats(-10.0, 10.0), st.sampled_from([0.0, 1.0, 1e-200]))
quaternions = st.tuples(parts, parts, parts, parts)
frictions = st.floats(0.0, 2.0, exclude_min=True)
edges = st.floats(0.0, 100.0, exclude_min=True)
names = st.text("abc", min_size=1, max_size=2)
boxes = st.fixed_dictionaries(
    {"name": names, "kind": st.just("box"), "center_m": positions, "size_m": st.tuples(edges, edges, edges)},
    optional={
        "yaw_rad": st.none() | st.floats(-100.0, 100.0),
        "orientation_wxyz": st.none() | quaternions,
        "friction": st.none() | frictions,
    },
)
rails = st.fixed_dictionaries(
    {
        "name": names,
        "kind": st.just("rail"),
        "from_m": positions,
        "to_m": positions,
        "radius_m": st.floats(0.0, 0.5, exclude_min=True),
    },
    optional={"friction": st.none() | frictions},
)
contacts = st.fixed_dictionaries(
    {"effector": st.sampled_from([*SHAPES, "tail"]), "position_m": positions},
    optional={"orientation_wxyz": quaternions},
)
phases = st.fixed_dictionaries(
    {"duration_s": st.floats(-1e4, 1e4) | st.just(1.0), "contacts": st.lists(contacts, max_size=4)}
)
scenarios = st.fixed_dictionaries(
    {
        "name": st.just("any"),
        "robot": st.just("talos"),
        "friction": frictions,
        "terrain": st.lists(boxes | rails, max_size=4),
        "phases": st.lists(phases, max_size=5),
    }
)


def answered(report: ValidationReport) -> ScenarioCheck:
    """As the service answers: the contract refuses numbers that are not finite."""
    return ScenarioCheck(
        valid=report.valid,
        errors=[{"where": fault.where, "message": fault.message} for fault in report.faults],
        warnings=[{"code": remark.code, "message": remark.message} for remark in report.remarks],
        margins=[vars(margin) for margin in report.margins],
        support_region_m=[list(rest.region_m) for rest in report.rests],
        support=[
            {"phase": k, "margin_m": rest.margin_m, "com_m": None if rest.com_m is None else rest.com_m.tolist()}
            for k, rest in enumerate(report.rests)
        ],
        duration_s=report.duration_s,
    )


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(scenarios)
def test_no_scenario_makes_the_judge_fall_over(scenario: Made) -> None:
    whole = Scenario.model_validate(scenario)
    report = validate_scenario(whole.model_dump(mode="json"), SHAPES)
    assert answered(report).valid is not bool(report.faults)
    assert len(report.rests) == len(whole.phases)


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([flat_walk, six_stairs, stairs_with_rail]),
    st.integers(0, 14),
    st.sampled_from(["left_foot", "right_foot", "right_hand"]),
    positions,
    quaternions,
)
def test_no_dragged_contact_makes_the_judge_fall_over(
    build: Callable[[], Made], phase: int, effector: str, position: Any, quaternion: Any
) -> None:
    scenario = build()
    for entry in scenario["phases"][phase]["contacts"]:
        if entry["effector"] == effector:
            entry.update(position_m=position, orientation_wxyz=quaternion)
    answered(validate_scenario(scenario, SHAPES))


@pytest.mark.parametrize("name", ["six-stairs", "stairs-with-rail", "stepping-stones"])
def test_the_outline_is_the_judges_sequence(name: str) -> None:
    """The checks that an editor leaves out are those that refuse nothing here."""
    scenario = json.loads((models_dir() / "scenarios" / f"{name}.json").read_text())
    shapes = effector_shapes(scenario["robot"])
    faults, sequence = validate_quickly(scenario, shapes)
    assert faults == ()
    assert repr(sequence) == repr(validate_and_build(scenario, shapes)[1])
    scenario["phases"][2]["contacts"][0]["position_m"][2] += 0.2
    report = validate_and_build(scenario, shapes)[0]
    faults, nothing = validate_quickly(scenario, shapes)
    assert nothing is None
    assert faults == tuple(fault for fault in report.faults if "at rest" not in fault.message)
