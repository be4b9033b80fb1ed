"""Speed of the whole-body stage; run by ``make bench`` (skipped otherwise). Milliseconds per sample as extra info."""

from stridelab.robots.loader import load_robot
from stridelab.wholebody.certify import certify
from stridelab.wholebody.controller import WholeBodyController
from support.sway import sway

DURATION_S = 4.0


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
