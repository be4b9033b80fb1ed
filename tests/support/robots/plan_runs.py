"""A run of ``plan-motion`` with all that it left.

Scenarios and runs of ``plan-motion`` for tests, and solvers that do not do what they should.
"""

import ctypes
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq

from stridelab.contacts.scenarios.parts import Timing
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.errors import Fault
from stridelab.schemas.plans import PlanMotionInput, PlanMotionSummary, PlanMotionTask
from stridelab.schemas.scenarios import Scenario
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.plan_motion import run as plan_motion
from stridelab.service.processes.child import with_json
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.motion import WholeBodyMotion, WholeBodyStopped
from support.command_line import Told


class Planned(NamedTuple):
    folder: Path
    outcome: Outcome
    summary: PlanMotionSummary
    told: Told

    def columns(self, table: str, *names: str) -> np.ndarray:
        read = pq.read_table(self.folder / table)
        return np.column_stack([read[name].to_numpy() for name in names])

    def arrays(self) -> dict[str, np.ndarray]:
        with np.load(self.folder / "motion.npz", allow_pickle=False) as read:
            return dict(read)


def run(folder: Path, scenario: Scenario, **asked: Any) -> Planned:
    told = Told()
    outcome = plan_motion.run(plan_task(scenario, **asked), folder, told)
    return Planned(folder, outcome, PlanMotionSummary.model_validate(outcome.summary), told)


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


def stopping_after(time_s: float) -> Callable[[], Any]:
    """A controller whose motion ends at ``time_s``, for want of torque in a knee."""

    class Stopping:
        def run(self, *asked: Any) -> WholeBodyMotion:
            motion = WholeBodyController().run(*asked)
            n = round(time_s * motion.rate_hz) + 1
            cut = {name: value[:n] for name, value in vars(motion).items() if isinstance(value, np.ndarray)}
            forces_n = {name: forces[:n] for name, forces in motion.forces_n.items()}
            phase = motion.sequence.phase_at(time_s)
            names = ["torque of leg_right_4_joint"]
            faults = [Fault(f"phases[{phase}]", f"at {time_s:.2f} s: {names[0]}")]
            part = replace(motion, **cut, forces_n=forces_n)
            raise WholeBodyStopped("The whole body cannot go on.", faults, part, phase, 0, names)

    return Stopping


def plan_with_a_hanging_solver(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """``plan-motion`` in a child whose solver is a native call that never returns."""
    from stridelab.pipelines import plan_centroidal
    from stridelab.service.kinds.plan_motion import run as plan_motion

    plan_centroidal.solve = lambda *_args, **_options: ctypes.PyDLL(None).sleep(600)
    return with_json(plan_motion.run)(task, folder, progress)
