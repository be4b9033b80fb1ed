"""``commission-robot``: from the card of a robot to its densities and its first walk.

Writes the files of ``learn-reachability`` for both measures (``uniform.json``, ``uniform.npz``, ``conditioned.json``,
``conditioned.npz``), ``scenario.json``, the scenario of the walk, and ``turn.json``, ``stair.json`` and ``pace.json``,
those of the largest turn, highest stair and fastest pace that pass.
"""

import gzip
import json
from pathlib import Path
from typing import Final

from stridelab.machine.models_folder import add_models_folder
from stridelab.pipelines.commissioning.commission_robot import MEASURES, REFERENCES, commission_robot
from stridelab.pipelines.progress import ProgressCallback
from stridelab.reachability.store import load_card, load_cloud
from stridelab.schemas.robots import CommissionRobotTask
from stridelab.service.filenames import LEARNED_FILE, ROBOT_STATE_FILE
from stridelab.service.kinds.base import ArtifactFile, Outcome
from stridelab.service.kinds.result_tables import write_text_atomically
from stridelab.service.kinds.robots.reachability import plottable_reachability
from stridelab.service.kinds.robots.staged import MODELS_FOLDER, pack_files
from stridelab.service.kinds.robots.upload import robot_state

SCENARIO_FILE: Final = "scenario.json"
JSON, NPZ = "application/json", "application/x-npz"


def run(task: CommissionRobotTask, folder: Path, progress: ProgressCallback) -> Outcome:
    """Commission the robot that was staged in ``folder``; the summary is a ``CommissionRobotSummary``.

    Raises as ``stridelab.pipelines.commissioning.commission_robot.commission_robot``.
    """
    models = folder / MODELS_FOLDER
    add_models_folder(models)
    result = commission_robot(task.input, models, progress)
    robot, packed, artifacts = result.robot, {}, []
    for measure in MEASURES:
        for suffix, media_type in ((".json", JSON), (".npz", NPZ)):
            name = f"{measure}{suffix}"
            source = models / "reachability" / robot.name / name
            (folder / name).write_bytes(source.read_bytes())
            packed[name] = source
            artifacts.append(ArtifactFile(name, media_type))
        card = load_card(robot.name, measure)
        shapes = plottable_reachability(robot, card, load_cloud(robot.name, measure))
        plot = folder / f"{measure}-reachability.json.gz"
        plot.write_bytes(gzip.compress(shapes.model_dump_json().encode(), mtime=0))
        packed[plot.name] = plot
    pack_files(packed, folder / LEARNED_FILE)
    write_text_atomically(folder / ROBOT_STATE_FILE, json.dumps(robot_state(robot)))
    write_text_atomically(folder / SCENARIO_FILE, json.dumps(result.scenario, indent=1) + "\n")
    artifacts.append(ArtifactFile(SCENARIO_FILE, JSON))
    for name, scenario in result.capability_scenarios.items():
        write_text_atomically(folder / f"{name}.json", json.dumps(scenario, indent=1) + "\n")
        artifacts.append(ArtifactFile(f"{name}.json", JSON))
    return Outcome(result.summary.model_dump(mode="json"), REFERENCES, tuple(artifacts))
