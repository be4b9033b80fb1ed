"""``plan-contacts``: plans contacts from a stance to a goal stance over a terrain, as a scenario (section 4.2).

Writes ``scenario.json``, the body of ``POST /scenarios``.
"""

from pathlib import Path
from typing import Final

from stridelab.pipelines.plan_contacts import REFERENCES, plan_contacts
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.plans import PlanContactsTask
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_text_atomically

SCENARIO_FILE: Final = "scenario.json"


def run(task: PlanContactsTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Plan into ``folder``; the summary is a ``PlanContactsSummary``. Raises as ``pipelines.plan_contacts`` does."""
    summary = plan_contacts(task.input, progress)
    text = summary.scenario.model_dump_json(indent=2, exclude_none=True) + "\n"
    write_text_atomically(folder / SCENARIO_FILE, text)
    progress(1.0, "done")
    return Outcome(summary.model_dump(mode="json"), REFERENCES, (ArtifactFile(SCENARIO_FILE, "application/json"),))
