"""Speed of the whole-body stage; run by ``make bench`` (skipped otherwise). Milliseconds per sample as extra info."""

import jaxtyping
import pytest

from stridelab.robots.loader import load_robot
from stridelab.wholebody.certify import certify
from stridelab.wholebody.controller import WholeBodyController
from support.sway import sway

DURATION_S = 4.0


@pytest.fixture(autouse=True)
def as_in_production():
    """The run-time checks of annotations belong to the tests; users do not pay for them."""
    before = jaxtyping.config.jaxtyping_disable
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", before)


def test_controller(benchmark):
    robot = load_robot("talos")
    plan = sway(robot, DURATION_S)
    motion = benchmark(lambda: WholeBodyController().run(robot, plan.sequence, plan))
    benchmark.extra_info["ms_per_sample"] = round(1e3 * benchmark.stats.stats.median / len(motion.time_s), 3)


def test_certificate(benchmark):
    robot = load_robot("talos")
    plan = sway(robot, DURATION_S)
    motion = WholeBodyController().run(robot, plan.sequence, plan)
    benchmark(lambda: certify(robot, plan.sequence, plan, {}, motion))
    benchmark.extra_info["ms_per_sample"] = round(1e3 * benchmark.stats.stats.median / len(motion.time_s), 3)
