"""Speed of the contact planner; run by ``make bench`` (skipped otherwise)."""

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.errors import NotEstimable
from stridelab.reachability.planner_limits import planner_limits
from support.robots.scenario_bodies import KINDS, box, random_task, task

SURFACES = 14


def stones(*, uneven):
    """14 surfaces in a row, level or up to 0.15 m higher or lower than the one before."""
    rng, x, top, boxes = np.random.default_rng(3), -0.25, 0.0, []
    for i in range(SURFACES):
        length, gap = (rng.uniform(0.42, 0.55), rng.uniform(0.0, 0.1)) if uneven else (0.5, 0.02)
        boxes.append(box(f"stone {i}", (x, x + length), top))
        x, goal = x + length + gap, (x + length / 2, top)
        top += rng.uniform(-0.15, 0.15) if uneven else 0.0
    return task(boxes, *goal)


@pytest.fixture(scope="module")
def planner():
    return ContactPlanner(effector_shapes("talos"), planner_limits("talos"))


@pytest.mark.parametrize("ground", ["level", "uneven"])
def test_24_steps_over_14_surfaces(benchmark, planner, ground):
    """About 7 m; regions, pruning, the program and the judge."""
    request = stones(uneven=ground == "uneven")
    plan = benchmark(lambda: planner.plan(request))
    assert plan.steps == 24
    benchmark.extra_info["steps"] = plan.steps


@pytest.mark.parametrize("kind", KINDS)
def test_ten_random_terrains(benchmark, planner, kind):
    """Tasks with and without a solution, as they are drawn."""
    rng = np.random.default_rng(KINDS.index(kind))
    request = [random_task(rng, kind) for _ in range(10)]
    successes = benchmark.pedantic(lambda: [has_solution(planner, each) for each in request], rounds=3)
    benchmark.extra_info["found"] = sum(successes)


def has_solution(planner, request):
    """Whether there is a way."""
    try:
        planner.plan(request)
    except NotEstimable:
        return False
    return True
