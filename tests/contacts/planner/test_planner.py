"""The contact planner: what it returns the judge lets pass, and where it finds nothing there is nothing."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlan, ContactPlanner
from stridelab.contacts.planner.schedule import Transition
from stridelab.contacts.planner.step_limits import BALL_COVER, EASY_AHEAD_SHARE, EASY_ASIDE_SHARE
from stridelab.contacts.scenarios.stairs import flat_walk, six_stairs, stairs_with_rail
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.reachability.planner_limits import planner_limits
from support.oracles.feasibility import best_objective
from support.robots.scenario_bodies import KINDS, box, feet, planks, random_task, task

SHAPES = effector_shapes("talos")
PLANNER = ContactPlanner(SHAPES, planner_limits("talos"))


def planned(request: dict[str, Any], planner: ContactPlanner = PLANNER) -> ContactPlan | NotEstimable:
    try:
        return planner.plan(request)
    except NotEstimable as refusal:
        return refusal


def of_scenario(scenario: dict[str, Any]) -> dict[str, Any]:
    first, last = ({"contacts": scenario["phases"][k]["contacts"]} for k in (0, -1))
    return {key: scenario[key] for key in ("robot", "terrain", "friction")} | {"start": first, "goal": last}


@pytest.mark.parametrize("build", [flat_walk, six_stairs, stairs_with_rail], ids=lambda build: build.__name__)
def test_bundled_courses_are_planned(build: Callable[[], dict[str, Any]]) -> None:
    request = of_scenario(build())
    plan = PLANNER.plan(request)
    assert validate_scenario(plan.scenario, SHAPES).faults == ()
    for phase, end in ((0, "start"), (-1, "goal")):
        result = {c["effector"]: c["position_m"] for c in plan.scenario["phases"][phase]["contacts"]}
        for contact in request[end]["contacts"]:
            np.testing.assert_allclose(result[contact["effector"]], contact["position_m"], atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_random_terrains(kind: str) -> None:
    """25 of each kind: every plan passes the judge, every refusal says where."""
    rng = np.random.default_rng(KINDS.index(kind))
    result = 0
    for _ in range(25):
        request = random_task(rng, kind, most=4)
        answer = planned(request)
        if isinstance(answer, ContactPlan):
            result += 1
            assert validate_scenario(answer.scenario, SHAPES).faults == ()
        else:
            assert answer.code == "contacts-unreachable"
            assert answer.faults
    assert result >= 5


@pytest.mark.parametrize("seed", range(12))
def test_an_exhaustive_search_agrees(seed: int) -> None:
    """Same answer and same objective as trying every region for every step, for every number of steps in turn."""
    rng = np.random.default_rng(100 + seed)
    request = random_task(rng, ("gaps", "stairs up", "stairs down")[seed % 3], most=2)
    planner = ContactPlanner(SHAPES, PLANNER.limits, extra_steps=1)
    answer = planned(request, planner)
    ends, rooms, least = planner.prepare_task(request)
    feet_in_turn = ("right_foot", "left_foot")
    tried = [
        best_objective(ends, planner.limits, rooms, steps, first)
        for steps in range(least, least + 2)
        for first in feet_in_turn
    ]
    expected = next((value for value in tried if value is not None), None)
    if expected is None:
        assert isinstance(answer, NotEstimable)
    else:
        assert isinstance(answer, ContactPlan)
        assert answer.objective_m == pytest.approx(expected, rel=2e-4, abs=1e-5)


def test_a_gap_is_named_with_what_is_missing() -> None:
    """A step spans 0.573 m at most; both soles keep 5 cm from their edges, so that 0.5 m of gap need 0.8 m."""
    reach = float(PLANNER.limits.offset_box_m("left_foot")[1][0])
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(planks(0.5))
    assert refusal.value.code == "contacts-unreachable"
    assert refusal.value.faults[0].where == "terrain[plank 1]"
    assert f"{0.5 + 2 * 0.15 - reach:.3f} m farther ahead" in refusal.value.message
    assert "plank 0" in refusal.value.message


def test_a_stair_too_high_is_named() -> None:
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(task([box("ground", (-1.0, 0.4), 0.0), box("wall", (0.4, 1.5), 0.4, thick_m=0.8)], 0.8, 0.4))
    assert "m farther up" in refusal.value.message
    assert refusal.value.faults[0].where == "terrain[wall]"


def island() -> dict[str, Any]:
    """A platform 0.52 m ahead and 0.32 m aside of where a foot may stand: within the box of a step, not its ball."""
    request = task([box("start", (-0.4, 0.4), 0.0), box("island", (0.62, 1.62), 0.0)], 1.1, 0.0)
    request["terrain"][1]["center_m"][1] = 0.7 + 0.6
    for contact in request["goal"]["contacts"]:
        contact["position_m"][1] += 0.7 + 0.6
    return request


def test_a_step_that_misses_its_limits_is_named() -> None:
    """Every region is within a step of the one before; only the program sees that no step gets across.

    On both sides the feet need 0.15 m beside each other, which the left foot's step has to span as well.
    """
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(island())
    aside_m = 0.32 + 2 * PLANNER.limits.defaults.width_min_m
    lacking_m = (0.52 + aside_m) / np.sqrt(2.0) - BALL_COVER * PLANNER.limits.feet_distance_max_m
    assert refusal.value.code == "contacts-unreachable"
    assert refusal.value.faults[0].where.startswith("steps[")
    assert f"to 'island', left_foot misses its limits by {lacking_m:.2f} m" in refusal.value.message
    ends, rooms, least = PLANNER.prepare_task(island())
    assert all(
        best_objective(ends, PLANNER.limits, rooms, steps, first) is None
        for steps in (least, least + 1)
        for first in ("right_foot", "left_foot")
    )


def way_with(obstacle: dict[str, Any], width_m: float = 6.0) -> dict[str, Any]:
    """2 m over level ground with one more surface."""
    return task([box("ground", (-1.0, 3.0), 0.0, width_m=width_m), obstacle], 2.0, 0.0)


def block(x_m: float, y_m: float, size_m: tuple[float, float, float], low_m: float = 0.0) -> dict[str, Any]:
    center_m = [x_m, y_m, low_m + size_m[2] / 2]
    return {"name": "wall", "kind": "box", "center_m": center_m, "size_m": list(size_m)}


@pytest.mark.parametrize(
    "obstacle",
    [
        block(1.0, 0.0, (0.2, 6.0, 1.0)),
        block(1.0, 0.0, (0.01, 5.9, 1.0)),
        block(1.0, 0.0, (0.2, 6.0, 0.2), low_m=1.1),
        {"name": "wall", "kind": "rail", "from_m": [1.0, -3.0, 0.9], "to_m": [1.0, 3.0, 0.9], "radius_m": 0.03},
    ],
    ids=["wall", "thin wall", "beam overhead", "bar"],
)
def test_a_wall_right_across_is_impassable(obstacle: dict[str, Any]) -> None:
    PLANNER.plan(task(way_with(obstacle)["terrain"][:1], 2.0, 0.0))
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(way_with(obstacle))
    assert refusal.value.code == "contacts-unreachable"
    assert [fault.where for fault in refusal.value.faults] == ["terrain[wall]"]
    assert "'wall' can neither be stepped over nor passed below" in refusal.value.message


@pytest.mark.parametrize(
    ("x_m", "y_m", "size_m"),
    [
        (1.0, 0.0, (0.2, 1.2, 1.0)),
        (1.0, 0.0, (0.3, 0.6, 1.0)),
        (1.0, 0.35, (0.3, 0.3, 1.0)),
        (0.9, -0.1, (0.05, 0.05, 2)),
    ],
)
def test_an_obstacle_is_walked_around(x_m: float, y_m: float, size_m: tuple[float, float, float]) -> None:
    """Neither foot nor the line between both comes nearer to it than the body is wide."""
    plan = PLANNER.plan(way_with(block(x_m, y_m, size_m)))
    report = validate_scenario(plan.scenario, SHAPES)
    assert (report.faults, report.remarks) == ((), ())
    ahead_m, aside_m = PLANNER.limits.defaults.body_half_size_m
    stances = [{c["effector"]: c["position_m"] for c in phase["contacts"]} for phase in plan.scenario["phases"]]
    for left, right in ((s["left_foot"], s["right_foot"]) for s in stances if len(s) == 2):
        for share in np.linspace(0.0, 1.0, 21):
            x, y, _ = (1.0 - share) * np.array(left) + share * np.array(right)
            apart = (abs(x - x_m) - size_m[0] / 2 - ahead_m, abs(y - y_m) - size_m[1] / 2 - aside_m)
            assert max(apart) > -1e-6


def test_a_plan_does_not_depend_on_the_terrains_planned_before() -> None:
    """A planner stores the regions of one plan only: walls of the same name at two places, each with its own plan."""
    ways = [way_with(block(1.0, y_m, (0.2, 1.2, 1.0))) for y_m in (0.2, -0.2)]
    one_planner = [PLANNER.plan(way).scenario["phases"] for way in ways]
    fresh = [ContactPlanner(SHAPES, planner_limits("talos")).plan(way).scenario["phases"] for way in ways]
    assert one_planner == fresh
    assert one_planner[0] != one_planner[1]


def test_steps_around_an_obstacle_are_easy() -> None:
    """No step goes farther than one of a walk ahead or aside, and soles beside the wall leave room for half the body.

    In single support the trunk is above the sole, so that its middle keeps half the body's width from the wall.
    """
    limits = PLANNER.limits.defaults
    plan = PLANNER.plan(way_with(block(1.5, 0.3, (0.1, 1.2, 1.5))))
    stances = [{c["effector"]: np.array(c["position_m"]) for c in p["contacts"]} for p in plan.scenario["phases"]]
    apart = np.array([stance["left_foot"] - stance["right_foot"] for stance in stances if len(stance) == 2])
    assert np.abs(apart[:, 0]).max() <= EASY_AHEAD_SHARE * limits.step_m + 1e-6
    assert apart[:, 1].max() <= limits.width_min_m + EASY_ASIDE_SHARE * limits.step_m + 1e-6
    beside = [
        at for stance in stances for at in stance.values() if abs(at[0] - 1.5) < 0.05 + limits.body_half_size_m[0]
    ]
    edges = np.array([-0.3, 0.9])
    clear = [float(np.abs(at[1] - edges).min()) for at in beside]
    assert beside
    assert min(clear) >= limits.body_half_size_m[1] + limits.width_m / 2


def task_through_door(width_m: float) -> dict[str, Any]:
    """A wall across the way, with a door in its middle."""
    side_m = 3.0 - width_m / 2
    request = way_with(block(1.5, width_m / 2 + side_m / 2, (0.1, side_m, 2.0)))
    other = block(1.5, -width_m / 2 - side_m / 2, (0.1, side_m, 2.0)) | {"name": "other wall"}
    longer = task([box("ground", (-1.0, 4.0), 0.0)], 3.0, 0.0)
    return longer | {"terrain": [*longer["terrain"], request["terrain"][-1], other]}


def test_a_door_narrower_than_the_arms_is_passed_sideways() -> None:
    """0.8 m: TALOS is wider with its arms. In the door both soles are turned by a quarter turn, at the ends by none."""
    plan = PLANNER.plan(task_through_door(0.8))
    report = validate_scenario(plan.scenario, SHAPES)
    assert (report.faults, report.remarks) == ((), ())
    contacts = [contact for phase in plan.scenario["phases"] for contact in phase["contacts"]]
    turned = {}
    for contact in contacts:
        w, _, _, z = contact["orientation_wxyz"]
        turned[tuple(contact["position_m"])] = abs(np.rad2deg(2.0 * np.arctan2(z, w)))
    in_door = [angle for (x, _, _), angle in turned.items() if abs(x - 1.5) < 0.3]
    assert len(in_door) >= 2
    assert min(in_door) > 89.0
    assert [turned[tuple(c["position_m"])] for c in (contacts[0], contacts[-1])] == pytest.approx([0.0, 0.0])


def test_a_slit_is_impassable_sideways_too() -> None:
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(task_through_door(0.4))
    assert refusal.value.code == "contacts-unreachable"
    assert {fault.where for fault in refusal.value.faults} <= {"terrain[wall]", "terrain[other wall]"}


def test_a_low_bar_is_stepped_over() -> None:
    plan = PLANNER.plan(way_with(block(1.0, 0.0, (0.1, 6.0, 0.15))))
    assert plan.steps == PLANNER.plan(task([box("ground", (-1.0, 3.0), 0.0)], 2.0, 0.0)).steps
    assert validate_scenario(plan.scenario, SHAPES).faults == ()


def test_standing_still_is_a_plan() -> None:
    plan = PLANNER.plan(task([box("ground", (-1.0, 1.0), 0.0)], 0.0, 0.0))
    assert (plan.steps, len(plan.scenario["phases"])) == (0, 1)


def test_a_turn_takes_steps() -> None:
    """A quarter to the left on the spot: no step turns by more than 12 degrees."""
    request = task([box("ground", (-2.0, 2.0), 0.0, width_m=4.0)], 0.0, 0.0)
    half = np.sqrt(0.5)
    request["goal"]["contacts"] = [
        {"effector": name, "position_m": [-y, 0.0, 0.0], "orientation_wxyz": [half, 0.0, 0.0, half]}
        for name, y in (("left_foot", 0.09), ("right_foot", -0.09))
    ]
    plan = PLANNER.plan(request)
    assert plan.steps >= 8
    assert validate_scenario(plan.scenario, SHAPES).faults == ()


def test_tilted_stones() -> None:
    """Stones that lean 15 degrees to both sides: soles lie on them, and the judge's limits hold."""
    terrain = [box("start", (-0.4, 0.4), 0.0)]
    for i, side in enumerate((1.0, -1.0)):
        stone = box(f"stone {i}", (0.45 + 0.4 * i, 0.8 + 0.4 * i), 0.0)
        stone["orientation_wxyz"] = [float(np.cos(0.13)), side * float(np.sin(0.13)), 0.0, 0.0]
        terrain.append(stone)
    terrain.append(box("end", (1.25, 2.0), 0.0))
    plan = PLANNER.plan(task(terrain, 1.6, 0.0))
    assert validate_scenario(plan.scenario, SHAPES).faults == ()
    names = {c["orientation_wxyz"][1] != 0.0 for phase in plan.scenario["phases"] for c in phase["contacts"]}
    assert names == {True, False}


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"start": {"contacts": feet(0.0, 0.3)}}, "start.contacts[left_foot]"),
        ({"goal": {"contacts": feet(9.0, 0.0)}}, "goal.contacts[left_foot]"),
        ({"goal": {"contacts": feet(0.3, 0.0)[:1]}}, "goal.contacts"),
        ({"terrain": [{"name": "x", "kind": "ball"}]}, "terrain[0]"),
        ({"friction": -1.0}, "friction"),
    ],
)
def test_ends_that_cannot_be_are_named(change: dict[str, Any], where: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        PLANNER.plan(task([box("ground", (-1.0, 1.0), 0.0)], 0.5, 0.0) | change)
    assert refusal.value.code == "stance-invalid"
    assert where in {fault.where for fault in refusal.value.faults}


def test_a_foot_that_cannot_be_read_is_not_reported_as_missing() -> None:
    wrong = feet(0.5, 0.0)
    wrong[0]["position_m"] = [0.5, 0.09]
    with pytest.raises(InvalidInput) as refusal:
        PLANNER.prepare_task(task([box("ground", (-1.0, 1.0), 0.0)], 0.5, 0.0) | {"goal": {"contacts": wrong}})
    assert [fault.where for fault in refusal.value.faults] == ["goal.contacts[left_foot]"]


def test_a_goal_too_far_is_refused_at_once() -> None:
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(task([box("ground", (-1.0, 60.0), 0.0)], 50.0, 0.0))
    assert refusal.value.code == "contacts-too-far"


def test_no_step_goes_as_far_as_a_forbidden_one() -> None:
    """The right foot's steps of a flat walk are shorter by a quarter, and the others take over what they lack."""
    request = of_scenario(flat_walk())

    def longest_m(forbidden: tuple[Transition, ...]) -> float:
        phases = PLANNER.plan(request, forbidden=forbidden).scenario["phases"]
        ahead = [{c["effector"]: c["position_m"][0] for c in phase["contacts"]} for phase in phases]
        return float(max(x["right_foot"] - x["left_foot"] for x in ahead if len(x) == 2))

    before_m = longest_m(())
    assert before_m > 0.25
    cut = Transition("right_foot", (before_m, -PLANNER.limits.defaults.width_m))
    assert longest_m((cut,)) == pytest.approx(0.75 * before_m, abs=1e-6)


def test_where_no_step_is_left_the_transitions_are_blamed() -> None:
    standing = PLANNER.limits.defaults.width_m
    cuts = [Transition(foot, (0.05, side * standing)) for foot, side in (("left_foot", 1.0), ("right_foot", -1.0))]
    with pytest.raises(NotEstimable) as refusal:
        PLANNER.plan(of_scenario(flat_walk()), forbidden=cuts)
    assert refusal.value.code == "contacts-unreachable"
    assert "transitions that the body cannot carry out" in refusal.value.message
