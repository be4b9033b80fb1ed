"""Stated torques that cannot hold the robot on one leg: statics by hand, remarks, and estimates that are chosen."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import approx_fprime, least_squares

from stridelab.robots.proposal import posture
from stridelab.robots.proposal.limbs import find_limbs
from stridelab.robots.proposal.offered_estimates import chosen_estimate, estimate_of, take_estimates
from stridelab.robots.proposal.posture import GRAVITY, rest_posture, single_supports, standing_torques_nm
from stridelab.robots.proposal.propose import Proposal, propose_card, rebuild_description
from stridelab.robots.proposal.soles import Sole
from stridelab.robots.urdf import full_model
from support.robots.humanoid import HALF_SOLE_M, SOLE_AHEAD_M, SOLE_DROP_M, Humanoid, archive

STANDING = re.compile(r"standing on one leg(?: alone)? takes ([0-9.]+) N m")


def proposal_of(humanoid: Humanoid, folder: Path) -> Proposal:
    upload = folder / "upload"
    upload.write_bytes(archive({"small/small.urdf": humanoid.urdf()}))
    assumed = rebuild_description(upload, "small.zip", "small", folder / "robots")
    return propose_card("small", "small", folder / "robots", assumed)


def test_derivatives_of_posture_searches_are_those_of_finite_differences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = []

    def compare_slopes(residuals: Any, first: np.ndarray, jacobian: Any, bounds: Any, max_nfev: int) -> Any:
        inside = np.clip(first, bounds[0] + 1e-3, bounds[1] - 1e-3)
        expected = approx_fprime(inside, residuals, 1e-7)
        compared.append(np.abs(jacobian(inside) - expected).max())
        return least_squares(residuals, first, jacobian, bounds=bounds, max_nfev=max_nfev)

    monkeypatch.setattr(posture, "least_squares", compare_slopes)
    path = tmp_path / "small.urdf"
    path.write_text(Humanoid().urdf())
    model = full_model(path)
    limbs = find_limbs(model, pin.neutral(model))
    R = pin.utils.rotate("z", 0.3) @ pin.utils.rotate("x", 0.2)
    sole = Sole(R, np.array([SOLE_AHEAD_M, 0.01, -SOLE_DROP_M]), HALF_SOLE_M, HALF_SOLE_M)
    rest_posture(model, limbs, (sole, sole), 0.25)
    assert len(compared) > len(limbs.legs) + len(limbs.arms)
    assert max(compared) < 1e-5


def test_torques_on_one_leg_are_those_of_the_weights_above_the_joint(tmp_path: Path) -> None:
    path = tmp_path / "small.urdf"
    path.write_text(Humanoid().urdf())
    model = full_model(path)
    limbs = find_limbs(model, pin.neutral(model))
    sole = Sole(np.eye(3), np.array([SOLE_AHEAD_M, 0.0, -SOLE_DROP_M]), HALF_SOLE_M, HALF_SOLE_M)
    q_rest, leg_m = rest_posture(model, limbs, (sole, sole), 0.25)
    postures = list(single_supports(model, limbs, (sole, sole), q_rest, leg_m))
    assert {stance for stance, _, _ in postures} == {0, 1}
    for stance, R, q in postures:
        leg = limbs.legs[stance]
        torques_nm = standing_torques_nm(model, leg[-1], R, q)
        weight_n = GRAVITY * pin.computeTotalMass(model)
        assert np.abs(torques_nm[:6]).max() < 1e-9 * weight_n, "the ground holds the whole robot"
        data = model.createData()
        com = pin.centerOfMass(model, data, q)
        pin.updateFramePlacements(model, data)
        centre = data.oMi[leg[-1]].act(sole.centre_m)
        assert (R.T @ (com - centre))[:2] == pytest.approx((0.0, 0.0), abs=0.02 * leg_m)
        for place, joint in enumerate(leg):
            below = set(leg[place:])
            moment_nm = np.zeros(3)
            for body in range(1, model.njoints):
                if body not in below:
                    inertia = model.inertias[body]
                    arm_m = data.oMi[body].act(inertia.lever) - data.oMi[joint].translation
                    moment_nm += np.cross(arm_m, -GRAVITY * inertia.mass * R[:, 2])
            axis = pin.computeJointJacobian(model, data, q, joint)[3:, model.joints[joint].idx_v]
            expected = float(data.oMi[joint].rotation @ axis @ moment_nm)
            assert torques_nm[model.joints[joint].idx_v] == pytest.approx(expected, abs=1e-8 * weight_n)


def test_torques_that_hold_no_posture_on_one_leg_stay_as_stated_and_have_an_estimate(tmp_path: Path) -> None:
    for name in ("strong", "weak"):
        (tmp_path / name).mkdir()
    strong = proposal_of(Humanoid(), tmp_path / "strong")
    assert not [how for how in strong.assumed.values() if estimate_of(how)]
    weak = proposal_of(Humanoid(effort=20.0), tmp_path / "weak")
    remark = weak.assumed["limits.torque_nm.left_knee"]
    assert remark.startswith("20 N m as stated, which is implausible: standing on one leg takes")
    index = weak.robot.joint_names.index("left_knee")
    assert weak.robot.model.effortLimit[6 + index] == 20.0
    assert weak.card.limits.torque_nm["left_knee"] == 20.0
    assert (estimate_of(remark) or 0.0) > 20.0
    card, assumed = take_estimates(weak.card, weak.assumed)
    assert card.limits.torque_nm["left_knee"] == estimate_of(remark)
    assert assumed["limits.torque_nm.left_knee"] == chosen_estimate(remark)
    assert "in place of" in chosen_estimate(remark)
    assert estimate_of(chosen_estimate(remark)) is None, "a choice is no offer"


@pytest.mark.parametrize(("share", "is_plausible"), [(1.45, False), (1.6, True)])
def test_knees_need_half_as_much_again_for_walking(share: float, is_plausible: bool, tmp_path: Path) -> None:
    for name in ("weak", "other"):
        (tmp_path / name).mkdir()
    weak = proposal_of(Humanoid(effort=20.0), tmp_path / "weak")
    found = STANDING.search(weak.assumed["limits.torque_nm.left_knee"])
    assert found is not None
    other = proposal_of(Humanoid(effort=share * float(found[1])), tmp_path / "other")
    assert ("limits.torque_nm.left_knee" not in other.assumed) == is_plausible
