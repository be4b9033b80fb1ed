"""Experiment 1 with the bundled scenario and proxies: the bars that every bundled motion has to clear.

The two stair experiments take the same way through the whole pipeline in the tests of ``plan-motion``.
"""

import json

import numpy as np
import pytest

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.machine.models_folder import models_dir
from stridelab.reachability.store import load_proxies
from stridelab.robots.robot import Robot
from stridelab.wholebody.certificate.certificate import Certificate
from stridelab.wholebody.certificate.certify import certify
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion

COM_HEIGHT_M = 0.86


@pytest.fixture(scope="module")
def long_stride(talos: Robot) -> tuple[WholeBodyMotion, Certificate]:
    scenario = json.loads((models_dir() / "scenarios" / "long-stride.json").read_text(encoding="utf-8"))
    sequence, proxies = sequence_of(scenario, effector_shapes("talos")), load_proxies("talos")
    first, last = (standing_com_m(sequence.phases[i].contacts, COM_HEIGHT_M, talos.effectors) for i in (0, -1))
    plan = solve(CentroidalProblem(sequence, talos.mass_kg, talos.effectors, proxies, first, last))
    assert plan.converged
    motion = WholeBodyController().run(talos, sequence, plan)
    return motion, certify(talos, sequence, plan, proxies, motion)


def test_the_long_stride_is_certified(long_stride: tuple[WholeBodyMotion, Certificate]) -> None:
    _, certificate = long_stride
    assert [check for check in certificate.checks if not check.passed] == []


def test_it_is_well_inside_its_bars(long_stride: tuple[WholeBodyMotion, Certificate]) -> None:
    motion, certificate = long_stride
    value = {check.name: check.value for check in certificate.checks}
    assert motion.failures == ()
    assert value["com_error_max"] < 3e-4
    assert value["landing_error_max"] < 3e-4
    assert value["torque_ratio_max_legs_torso"] < 0.8
    assert value["terrain_distance_min"] > 0.004


def test_the_body_travels_as_far_as_its_feet(long_stride: tuple[WholeBodyMotion, Certificate]) -> None:
    motion, _ = long_stride
    travelled = motion.com_m[-1] - motion.com_m[0]
    feet = [
        contact.placement.position_m
        for phase in (motion.sequence.phases[0], motion.sequence.phases[-1])
        for contact in phase.contacts.values()
    ]
    assert np.allclose(travelled, np.mean(feet[2:], axis=0) - np.mean(feet[:2], axis=0), atol=1e-3)
    assert travelled[0] > 1.5
