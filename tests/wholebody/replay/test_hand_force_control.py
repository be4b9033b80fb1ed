"""How hard a hand presses where the plan asks for less, and where it is brought."""

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
import pytest

from stridelab.contacts.sequence import Contact
from stridelab.conventions import Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.robots.robot import Robot
from stridelab.wholebody.limb_kinematics import LimbKinematics
from stridelab.wholebody.replay.hand_force_control import Grip, HandForceControl
from stridelab.wholebody.replay.sensors import SensedState

WEIGHT_N = 550.0
GRIP = Grip(least_n=25.0, pressure_m=0.02)
SOLES_M = np.array([0.0, 0.0, 0.1])
TO_THE_LEFT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Axes of a wall at the robot's right: z away from it."""


def hand(position_m: list[float], rotation: np.ndarray) -> Contact:
    place = Placement(np.array(position_m), rotation)
    return Contact("right_hand", place, "surface", 0.5, "point")


@pytest.mark.parametrize(("position_m", "rotation"), [([0.2, -0.7, 0.95], TO_THE_LEFT), ([0.3, -0.4, 0.7], np.eye(3))])
def test_it_moves_the_centre_of_pressure_by_no_more_than_allowed(position_m: list[float], rotation: np.ndarray) -> None:
    """Equilibrium of moments about the soles: those of the hand are those of the weight on a lever of 2 cm."""
    there = hand(position_m, rotation)
    pressed_n = GRIP.force_reference_n(0.0, there, SOLES_M, WEIGHT_N)
    moment = np.cross(there.placement.position_m - SOLES_M, pressed_n * rotation[:, 2])
    assert pressed_n < GRIP.least_n
    assert np.hypot(*moment[:2]) == pytest.approx(0.02 * WEIGHT_N)


def test_above_the_soles_a_hand_on_a_wall_presses_less_than_on_a_rail_beside_the_hip() -> None:
    wall, rail = hand([0.1, -0.75, 0.95], TO_THE_LEFT), hand([0.1, -0.45, 0.7], np.eye(3))
    on_wall, on_rail = (GRIP.force_reference_n(0.0, there, SOLES_M, WEIGHT_N) for there in (wall, rail))
    assert on_wall == pytest.approx(0.02 * WEIGHT_N / 0.85)
    assert on_wall < on_rail < GRIP.least_n


def test_what_is_planned_is_pressed_and_near_the_soles_the_least_is() -> None:
    assert GRIP.force_reference_n(60.0, hand([0.1, -0.75, 0.95], TO_THE_LEFT), SOLES_M, WEIGHT_N) == 60.0
    assert GRIP.force_reference_n(0.0, hand([0.05, -0.1, 0.7], np.eye(3)), SOLES_M, WEIGHT_N) == GRIP.least_n


STRONG = Grip(torque_share=np.inf)
"""Of an arm without a limit of its torques."""
DT_S = 0.004
ANGLED = np.array([-0.2, 0.0, -0.1, -1.3])
"""Of a right arm whose elbow is bent, so that its Jacobian has rank three."""


@pytest.fixture(scope="module")
def posed(talos: Robot) -> LimbKinematics:
    result = LimbKinematics(talos, ("right_hand",))
    q = talos.q_reference.copy()
    q[7 + result.limb["right_hand"][:4]] = ANGLED
    result.set_configuration(q)
    return result


def sensed(posed: LimbKinematics, base_off_m: Vector3, hand_off_m: Vector3, force_n: Vector3) -> SensedState:
    """The base and the hand beside their planned places."""
    there = posed.contact_placement("right_hand")
    q = np.concatenate([posed.base.position_m + base_off_m, pin.Quaternion(posed.base.rotation).coeffs()])
    at = {"right_hand": Placement(there.position_m + hand_off_m, there.rotation)}
    still = np.zeros(3)
    return SensedState(0.0, q, np.zeros(6), still, still, at, {"right_hand": force_n}, {"right_hand": still})


def after(
    posed: LimbKinematics, seen: SensedState, planned_n: Vector3 | None, seconds: float = 1.0
) -> tuple[Vector3, np.ndarray]:
    """By how much the command of the hand is offset, and its torques, after a while; planned to be in the air: None."""
    return after_all(posed, ((seen, seconds),), planned_n)


def after_all(
    posed: LimbKinematics, seen: Iterable[tuple[SensedState, float]], planned_n: Vector3 | None
) -> tuple[Vector3, np.ndarray]:
    """The same after one thing has been seen for some seconds, and then another."""
    touching = {} if planned_n is None else {"right_hand": on_top(posed)}
    planned = {} if planned_n is None else {"right_hand": planned_n}
    hands = HandForceControl(STRONG, posed, ("right_hand",), DT_S)
    for what, seconds in seen:
        for _ in range(round(seconds / DT_S)):
            angles, tau = hands.compute_corrections(what, touching, planned, dict.fromkeys(touching, 25.0), REST_NM)
    limb = posed.limb["right_hand"]
    return posed.limb_jacobian("right_hand")[:3] @ angles[limb], tau[limb]


def on_top(posed: LimbKinematics) -> Contact:
    return hand(posed.contact_placement("right_hand").position_m.tolist(), np.eye(3))


def test_a_hand_in_the_air_is_brought_to_its_place_in_the_world(posed: LimbKinematics) -> None:
    base_off_m = np.array([0.02, -0.03, 0.01])
    moved_m, tau = after(posed, sensed(posed, base_off_m, base_off_m, np.zeros(3)), None)
    assert moved_m == pytest.approx(-base_off_m, abs=2e-3)
    assert not tau.any()


def test_a_hand_that_touches_stays_where_it_landed_whatever_the_base_does(posed: LimbKinematics) -> None:
    base_off_m, landed_m = np.array([0.0, -0.05, 0.0]), np.array([0.012, -0.008, 0.0])
    moved_m, _ = after(
        posed, sensed(posed, base_off_m, landed_m, np.array([0.0, 0.0, 25.0])), np.array([0.0, 0.0, 25.0])
    )
    assert moved_m == pytest.approx(landed_m, abs=1e-3)


REST_NM = np.zeros(32)
PRESSED_N = np.array([0.0, 0.0, 25.0])
LANDED_M, SLID_M = np.array([0.012, -0.008, 0.0]), np.array([0.020, 0.030, 0.0])


@pytest.mark.parametrize("off_s", [0.0, 0.04])
def test_a_hand_that_slides_or_lets_go_for_a_moment_is_drawn_back_to_where_it_landed(
    posed: LimbKinematics, off_s: float
) -> None:
    """Its command neither follows where it has slid, nor lifts it."""
    landed, slid = (sensed(posed, np.zeros(3), off_m, PRESSED_N) for off_m in (LANDED_M, SLID_M))
    let_go = sensed(posed, np.zeros(3), SLID_M, np.zeros(3))
    moved_m, _ = after_all(posed, ((landed, 0.5), (slid, 0.1), (let_go, off_s)), PRESSED_N)
    assert moved_m == pytest.approx(LANDED_M, abs=2e-3)


def test_a_hand_searches_its_surface_at_the_same_speed_for_any_force(posed: LimbKinematics) -> None:
    """A light robot's reference of a few newtons would take seconds for a centimetre."""
    above, still = sensed(posed, np.zeros(3), np.zeros(3), np.zeros(3)), {"right_hand": np.zeros(3)}
    hands = HandForceControl(Grip(), posed, ("right_hand",), DT_S)
    for _ in range(round(0.25 / DT_S)):
        angles, _ = hands.compute_corrections(above, {"right_hand": on_top(posed)}, still, {"right_hand": 4.0}, REST_NM)
    moved_m = posed.limb_jacobian("right_hand")[:3] @ angles[posed.limb["right_hand"]]
    assert moved_m == pytest.approx([0.0, 0.0, -0.25 * Grip().search_m_s], abs=1.5e-3)


def test_after_a_longer_moment_a_hand_lands_anew(posed: LimbKinematics) -> None:
    landed, elsewhere = (sensed(posed, np.zeros(3), off_m, PRESSED_N) for off_m in (LANDED_M, SLID_M))
    let_go = sensed(posed, np.zeros(3), SLID_M, np.zeros(3))
    moved_m, _ = after_all(posed, ((landed, 0.5), (let_go, 0.06), (elsewhere, 0.5)), PRESSED_N)
    assert moved_m[:2] == pytest.approx(SLID_M[:2], abs=2e-3)


def test_a_planned_force_that_rises_takes_the_place_of_the_added_one_at_once(posed: LimbKinematics) -> None:
    """Both together would press twice; a planned force that ends is replaced at the limited rate."""
    touches = sensed(posed, np.zeros(3), LANDED_M, PRESSED_N)
    hands, touching = HandForceControl(STRONG, posed, ("right_hand",), DT_S), {"right_hand": on_top(posed)}
    limb = posed.limb["right_hand"]

    def added_nm(planned_n: float, samples: int) -> np.ndarray:
        planned = {"right_hand": np.array([0.0, 0.0, planned_n])}
        for _ in range(samples):
            _, tau = hands.compute_corrections(
                touches, touching, planned, {"right_hand": max(planned_n, 25.0)}, REST_NM
            )
        return np.asarray(tau[limb])

    step_n = Grip().rate_n_s * DT_S
    expected_n = {"before": (0.0, 100, -25.0), "rises": (38.0, 1, 0.0), "ends": (0.0, 3, -3 * step_n)}
    for planned_n, samples, missing_n in expected_n.values():
        missing = posed.torques_nm("right_hand", np.array([0.0, 0.0, missing_n]))
        assert added_nm(planned_n, samples) == pytest.approx(missing, abs=1e-9)


def test_a_hand_that_lets_go_for_a_moment_presses_on_nothing_at_once(posed: LimbKinematics) -> None:
    """Its force goes as fast as torques may change, 8 N in 0.04 s, while its place is still controlled."""
    planned_n = np.array([0.0, 0.0, 8.0])
    landed = sensed(posed, np.zeros(3), LANDED_M, PRESSED_N)
    let_go = sensed(posed, np.zeros(3), LANDED_M, np.zeros(3))
    _, pressing = after_all(posed, ((landed, 0.5),), planned_n)
    _, tau = after_all(posed, ((landed, 0.5), (let_go, 0.04)), planned_n)
    expected_n = np.array([0.0, 0.0, 8.0 - 25.0 + Grip().rate_n_s * 0.04])
    assert pressing == pytest.approx(posed.torques_nm("right_hand", planned_n - PRESSED_N), abs=1e-9)
    assert tau == pytest.approx(posed.torques_nm("right_hand", expected_n), abs=1e-9)


def test_a_hand_that_has_lost_its_rail_is_lifted_and_presses_on_nothing(posed: LimbKinematics) -> None:
    """With the planned force taken off, feed-forward and correction press with nothing in all."""
    planned_n = np.array([-8.0, 6.0, 24.0])
    lost = sensed(posed, np.zeros(3), np.array([0.0, -0.04, -0.03]), np.zeros(3))
    moved_m, tau = after(posed, lost, planned_n)
    assert moved_m[2] == pytest.approx(Grip().lift_m, abs=3e-3)
    assert tau == pytest.approx(posed.torques_nm("right_hand", planned_n), abs=1e-9)


def test_a_rail_that_is_not_there_yet_is_sought_straight_below(posed: LimbKinematics) -> None:
    moved_m, _ = after(posed, sensed(posed, np.zeros(3), np.zeros(3), np.zeros(3)), np.array([0.0, 0.0, 10.0]), 5.0)
    assert moved_m == pytest.approx([0.0, 0.0, -Grip().most_m], abs=3e-3)


def test_a_hand_that_the_plan_lifts_no_longer_presses(posed: LimbKinematics) -> None:
    """Its former force took 3 of 6.6 N m of a wrist of TALOS while lifting took 5."""
    touches = sensed(posed, np.zeros(3), np.zeros(3), PRESSED_N)
    hands, limb = HandForceControl(Grip(), posed, ("right_hand",), DT_S), posed.limb["right_hand"]
    touching, none = {"right_hand": on_top(posed)}, {"right_hand": np.zeros(3)}
    for _ in range(100):
        _, pressing = hands.compute_corrections(touches, touching, none, {"right_hand": 25.0}, REST_NM)
    _, lifted = hands.compute_corrections(touches, {}, {}, {}, REST_NM)
    assert np.abs(pressing[limb]).max() > 1.0
    assert not lifted.any()


def test_a_hand_presses_no_harder_than_half_of_its_weakest_joint_carries() -> None:
    """With a lever of 14 cm at the forearm of TALOS the usual 25 N take 3.5 of 3 N m; a plan's force is not reduced."""
    lever_m, limits_nm, rest_nm = np.array([0.3, 0.2, -0.14]), np.array([44.0, 17.9, 3.0]), np.zeros(3)
    assert Grip().bounded_reference_n(25.0, 0.0, rest_nm, lever_m, rest_nm, limits_nm) == pytest.approx(1.5 / 0.14)
    assert Grip().bounded_reference_n(25.0, 20.0, -20.0 * lever_m, lever_m, rest_nm, limits_nm) == 20.0
    assert Grip().bounded_reference_n(25.0, 0.0, rest_nm, 0.1 * lever_m, rest_nm, limits_nm) == 25.0
    drag_m = np.array([0.0, 0.0, 0.06])
    assert Grip().bounded_reference_n(25.0, 0.0, rest_nm, lever_m, drag_m, limits_nm) == pytest.approx(1.5 / 0.2)


@pytest.mark.parametrize(("planned_nm", "most_nm"), [(0.9, 1.5), (-0.9, 1.5), (1.6, 1.6)])
def test_what_a_hand_adds_comes_on_top_of_the_plan_of_its_joints(planned_nm: float, most_nm: float) -> None:
    """Half of the limit of a forearm is 1.5 N m, whatever its plan takes; a plan beyond that gets no more."""
    lever_m, limit_nm, plan_nm, planned_n = np.array([-0.14]), np.array([3.0]), np.array([planned_nm]), 2.0
    reference_n = Grip().bounded_reference_n(25.0, planned_n, plan_nm, lever_m, np.zeros(1), limit_nm)
    assert planned_nm - (reference_n - planned_n) * lever_m[0] == pytest.approx(most_nm)
