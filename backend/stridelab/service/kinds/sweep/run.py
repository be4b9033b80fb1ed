"""``sweep``: plans a scenario for every combination of parameter values, in parallel over the cores.

Writes ``sweep`` (Parquet and CSV), one row per scenario in the order of the values, the last field fastest.
"""

from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from stridelab.contacts.scenarios.variations import UNITS
from stridelab.machine.parallel import available_processes, map_isolated
from stridelab.pipelines.progress import ProgressCallback
from stridelab.pipelines.sweep_scenarios import Point, SweepRow, sweep_scenarios
from stridelab.schemas.sweeps import SweepTask
from stridelab.service.kinds.base import Outcome
from stridelab.service.kinds.result_tables import write_table

PRELOAD_MODULE: Final = "stridelab.pipelines.sweep_scenarios"
BODY_MODULE: Final = "stridelab.pipelines.sweep_whole_body"
CHUNK_TIMEOUT_S: Final = 1800.0


def run(task: SweepTask, folder: Path, progress: ProgressCallback, processes: int | None = None) -> Outcome:
    """Plan every scenario of the sweep into ``folder``; the summary is a ``SweepSummary``.

    Raises as ``stridelab.pipelines.sweep_scenarios.sweep_scenarios`` does.
    """
    at_once = processes or available_processes()
    preload = (BODY_MODULE,) if task.input.whole_body else (PRELOAD_MODULE,)
    map_points = partial(map_isolated, preload=preload, timeout_s=CHUNK_TIMEOUT_S, processes=at_once)
    result = sweep_scenarios(task, map_points, at_once, progress)
    about = {"scenario": task.scenario.name, "robot": task.scenario.robot, "vary": task.input.model_dump()["vary"]}
    files = write_table(folder, "sweep", _sweep_columns(result.grid, result.rows), about)
    progress(1.0, "done")
    return Outcome(result.summary.model_dump(mode="json"), result.citation_keys, files)


def _sweep_columns(grid: list[Point], rows: list[SweepRow]) -> dict[str, np.ndarray]:
    names = {field: f"{field}_{UNITS[field]}" if UNITS[field] else field for field in grid[0]}
    columns = {name: np.array([point[field] for point in grid]) for field, name in names.items()}
    columns["feasible"] = np.array([row.outcome == "feasible" for row in rows])
    columns["outcome"] = np.array([row.outcome for row in rows])
    columns["objective"] = np.array([row.objective for row in rows])
    columns["iterations"] = np.array([row.iterations for row in rows])
    columns["solve_time_s"] = np.array([row.solve_time_s for row in rows])
    columns["solver"] = np.array([row.solver for row in rows])
    columns["why"] = np.array([row.why for row in rows])
    return columns
