"""Scenarios and runs of ``plan-motion`` for tests, and solvers that do not do what they should."""

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stridelab.contacts.scenario_parts import Timing
from stridelab.contacts.stairs import flat_walk
from stridelab.schemas.plans import PlanMotionInput
from stridelab.schemas.scenarios import Scenario
from stridelab.service.jobs.kinds.tasks import PlanMotionTask


def short_walk() -> Scenario:
    """Two steps on flat ground: 3.4 s."""
    return Scenario.model_validate(flat_walk(steps=2, timing=Timing(0.8, 0.8, 0.2)))


def changed(scenario: Scenario, change: Callable[[dict[str, Any]], object]) -> Scenario:
    """The scenario after ``change`` was done to its plain form."""
    body = scenario.model_dump(mode="json")
    change(body)
    return Scenario.model_validate(body)


def plan_task(scenario: Scenario | None = None, **asked: Any) -> PlanMotionTask:
    body = scenario or short_walk()
    return PlanMotionTask(scenario=body, input=PlanMotionInput(scenario=body, **asked))


def plan_with_a_hanging_solver(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """``plan-motion`` in a child whose solver is a native call that never returns."""
    from stridelab.service.jobs.kinds import plan_motion

    plan_motion.solve = lambda *_args, **_options: ctypes.PyDLL(None).sleep(600)
    return plan_motion.run_in_child(task, folder, progress)
