"""Plan and body agree on the angular momentum: when it matters, and what planning for the limbs changes."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Scenario, Timing
from stridelab.contacts.scenarios.stairs import flat_walk, long_stride, stairs_with_rail
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Robot
from stridelab.wholebody import momentum_consistency
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.momentum_consistency import AGREEMENT_NMS, agree, limb_rates_nm, needs_replanning
from stridelab.wholebody.motion import WholeBodyMotion

Walked = tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]


@pytest.mark.parametrize(
    ("scenario", "expected"),
    [
        (flat_walk(), False),
        (long_stride(), False),
        (stairs_with_rail(), False),
        (long_stride(step_m=0.46), True),
        (flat_walk(timing=Timing(1.0, 0.79, 0.2)), True),
    ],
)
def test_it_matters_beyond_long_strides_and_slow_swings(scenario: Scenario, expected: bool) -> None:
    assert needs_replanning(sequence_of(scenario, effector_shapes("talos"))) is expected


@pytest.fixture(scope="module")
def problem(talos: Robot, proxies: Mapping[str, Proxy], two_steps: Walked) -> CentroidalProblem:
    sequence, plan, _ = two_steps
    return CentroidalProblem(sequence, talos.mass_kg, talos.effectors, proxies, plan.com_m[0], plan.com_m[-1])


def test_the_limbs_rates_add_up_to_their_momentum(problem: CentroidalProblem, two_steps: Walked) -> None:
    motion = two_steps[2]
    rates = limb_rates_nm(problem, motion)
    grid = problem.grid()
    assert rates.shape == (len(grid.step_s), 3)
    assert np.allclose(grid.step_s @ rates, motion.l_nms[-1] - motion.l_nms[0], atol=1e-12)


@pytest.mark.parametrize(("limit_share", "passes"), [(0.6, 1), (0.8, 2)])
def test_it_matters_where_the_momentum_comes_near_the_limit_of_the_certificate(
    talos: Robot,
    problem: CentroidalProblem,
    two_steps: Walked,
    monkeypatch: pytest.MonkeyPatch,
    limit_share: float,
    passes: int,
) -> None:
    """Whatever the swings; a second pass that gains nothing is the last one."""
    _, plan, motion = two_steps
    mismatch = float(np.linalg.norm(motion.l_nms - motion.l_reference_nms, axis=1).max())
    assert mismatch > AGREEMENT_NMS
    monkeypatch.setattr(momentum_consistency, "needs_replanning", lambda _: False)
    monkeypatch.setattr(momentum_consistency, "momentum_limit_nms", lambda _: mismatch / limit_share)
    result = agree(talos, problem, plan, lambda _: plan, lambda *_: motion)
    assert len(result.passes) == passes


def test_quick_steps_agree_after_a_second_plan(
    talos: Robot, proxies: Mapping[str, Proxy], problem: CentroidalProblem, two_steps: Walked
) -> None:
    sequence, plan, motion = two_steps
    result = agree(talos, problem, plan, solve, WholeBodyController().run)
    first, *later = [one.mismatch_max_nms for one in result.passes]
    assert first == np.linalg.norm(motion.l_nms - motion.l_reference_nms, axis=1).max()
    assert later
    assert min(later) < 0.4 * first
    apart = np.linalg.norm(result.motion.l_nms - result.motion.l_reference_nms, axis=1).max()
    assert apart == min(first, *later)
    checks = {check.name: check for check in certify(talos, sequence, result.plan, proxies, result.motion).checks}
    assert checks["angular_momentum_mismatch_max"].value == pytest.approx(apart, abs=1e-9)
    assert checks["com_error_max"].passed
    assert checks["solver_failures"].passed


def test_the_rates_of_splines_add_up_too(problem: CentroidalProblem, two_steps: Walked) -> None:
    smooth, motion = replace(problem, shape="cubic"), two_steps[2]
    rates, times_s = limb_rates_nm(smooth, motion), smooth.limb_times_s()
    assert rates.shape == (4 * len(problem.grid().step_s), 3)
    assert np.allclose(np.diff(times_s) @ rates, motion.l_nms[-1] - motion.l_nms[0], atol=0.1)
    assert np.abs(rates).max() > np.abs(limb_rates_nm(problem, motion)).max() * 0.5


def test_quick_steps_agree_with_splines(
    talos: Robot, proxies: Mapping[str, Proxy], problem: CentroidalProblem, two_steps: Walked
) -> None:
    """No worse than with constants, and every check passes."""
    smooth = replace(problem, shape="cubic")
    result = agree(talos, smooth, solve(smooth), solve, WholeBodyController().run)
    first, *later = [one.mismatch_max_nms for one in result.passes]
    assert min(later) < 0.3 * first
    assert min(later) < AGREEMENT_NMS
    assert [c for c in certify(talos, two_steps[0], result.plan, proxies, result.motion).checks if not c.passed] == []


def test_one_pass_on_request(talos: Robot, problem: CentroidalProblem, two_steps: Walked) -> None:
    _, plan, motion = two_steps
    reported: list[float] = []

    def tell(fraction: float, _message: str) -> None:
        reported.append(fraction)

    result = agree(talos, problem, plan, solve, WholeBodyController().run, tell, passes=1)
    assert len(result.passes) == 1
    assert result.plan is plan
    assert np.array_equal(result.motion.q, motion.q)
    assert reported == sorted(reported)
