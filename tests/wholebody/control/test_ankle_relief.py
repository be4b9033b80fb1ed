"""One foot on each stair: a foot behind the body lifts its heel first, and the CoM keeps its plan."""

from collections.abc import Mapping

import numpy as np
import pytest

from experiments.execution import whole_body_problem
from stridelab.centroidal.solver import solve
from stridelab.contacts import sequence_swings
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import Stairs, climb
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certify import COM_ERROR_M
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.control.joint_limits import JointLimits
from stridelab.wholebody.control.swing_detour import AnkleRelief

USUAL = Timing(1.5, 1.5, 0.3)
QUICK = Timing(1.5, 0.9, 0.2)


def com_error_m(talos: Robot, proxies: Mapping[str, Proxy], pace: Timing) -> tuple[float, float]:
    """Largest CoM error, and the smallest distance of an ankle from the end of its range as a share of it."""
    scenario = climb(Stairs(2, 0.167, 0.302), pace, "alternate")
    sequence = sequence_of(scenario, effector_shapes("talos"))
    plan = solve(whole_body_problem(talos, sequence, proxies))
    motion = WholeBodyController().run(talos, sequence, plan)
    limits = JointLimits.of_model(talos.model)
    ankles = [talos.joint_names.index(f"leg_{side}_5_joint") for side in ("left", "right")]
    angles, lower, upper = motion.q[:, 7:][:, ankles], limits.lower_rad[ankles], limits.upper_rad[ankles]
    share = np.minimum(angles - lower, upper - angles) / (upper - lower)
    return float(np.linalg.norm(motion.com_m - motion.com_reference_m, axis=1).max()), float(share.min())


def test_a_heel_that_lifts_first_keeps_the_com_on_its_plan(
    talos: Robot, proxies: Mapping[str, Proxy], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the usual profile of swings, not the gentle one of stairs, which spares the ankle already."""
    monkeypatch.setattr(sequence_swings, "gentle_windows", lambda curve, *_: curve.profile)
    error_m, share = com_error_m(talos, proxies, USUAL)
    assert error_m < COM_ERROR_M
    assert share > 0.03
    monkeypatch.setattr(AnkleRelief, "push", lambda *_: np.zeros(6))
    error_m, share = com_error_m(talos, proxies, USUAL)
    assert error_m > 2.0 * COM_ERROR_M
    assert share < 0.03


def test_a_heel_that_lifts_first_spares_the_ankle_of_gentle_swings(
    talos: Robot, proxies: Mapping[str, Proxy], monkeypatch: pytest.MonkeyPatch
) -> None:
    error_m, share = com_error_m(talos, proxies, QUICK)
    assert error_m < 0.5 * COM_ERROR_M
    assert share > 0.08
    monkeypatch.setattr(AnkleRelief, "push", lambda *_: np.zeros(6))
    _, less = com_error_m(talos, proxies, QUICK)
    assert less < 0.6 * share
