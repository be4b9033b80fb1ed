"""One robot and two short motions for all tests of the whole body."""

from collections.abc import Mapping

import numpy as np
import pytest

from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.loader import load_robot
from stridelab.robots.robot import Robot
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion
from support.robots.plans import sway

COM_HEIGHT_M = 0.86


@pytest.fixture(scope="session")
def talos() -> Robot:
    return load_robot("talos")


@pytest.fixture(scope="session")
def proxies() -> Mapping[str, Proxy]:
    """One normal density per foot: the CoM half a metre to one metre above it."""
    covariance = np.diag([0.2, 0.15, 0.1]) ** 2
    mean = np.array([[0.0, 0.0, 0.8]])
    return {name: Proxy(Mixture(np.ones(1), mean, covariance[None])) for name in ("left_foot", "right_foot")}


@pytest.fixture(scope="session")
def swaying(talos: Robot) -> tuple[CentroidalPlan, WholeBodyMotion]:
    """Two seconds of swaying on both feet."""
    plan = sway(talos, duration_s=2.0, amplitude_m=0.04, period_s=1.5)
    return plan, WholeBodyController().run(talos, plan.sequence, plan)


@pytest.fixture(scope="session")
def two_steps(talos: Robot, proxies: Mapping[str, Proxy]) -> tuple[ContactSequence, CentroidalPlan, WholeBodyMotion]:
    """Two steps of 0.2 m on level ground."""
    scenario = flat_walk(2, 0.2, Timing(0.8, 0.6, 0.2))
    sequence = sequence_of(scenario, effector_shapes("talos"))
    first, last = (standing_com_m(sequence.phases[i].contacts, COM_HEIGHT_M, talos.effectors) for i in (0, -1))
    plan = solve(CentroidalProblem(sequence, talos.mass_kg, talos.effectors, proxies, first, last))
    assert plan.converged
    return sequence, plan, WholeBodyController().run(talos, sequence, plan)
