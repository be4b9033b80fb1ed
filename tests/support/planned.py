"""A run of ``plan-motion`` with all that it left."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq

from stridelab.schemas.plans import PlanMotionSummary
from stridelab.schemas.scenarios import Scenario
from stridelab.service.jobs.kinds import plan_motion
from stridelab.service.jobs.kinds.kind import Outcome
from support.planning import plan_task
from support.quiet import Told


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
