"""What the how-tos add is added here, from their own lines, for the length of a test."""

import re
import runpy
import shutil
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios import bundled, stairs
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.estimation.estimator import ComEstimator
from stridelab.recordings import marker_sets
from stridelab.recordings.recording import Window
from stridelab.resources import models_dir
from stridelab.schemas import tasks
from stridelab.service.kinds import registry
from stridelab.service.kinds import staging as rows
from support.recordings.analytic_motions import walk

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to"


def blocks(page: str) -> list[str]:
    """Code of a page that is no shell, in order."""
    text = (HOW_TO / page).read_text(encoding="utf-8")
    found = re.findall(r"^( *)```(?:python|toml|text)\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)
    return [re.sub(rf"^{indent}", "", block, flags=re.MULTILINE) for indent, block in found]


def test_the_marker_set_is_read_and_recognised(monkeypatch: pytest.MonkeyPatch) -> None:
    (block,) = blocks("add-a-marker-set.md")
    known = marker_sets.parse_marker_set(tomllib.loads(block))
    shipped = dict(marker_sets.marker_sets())
    assert known.name not in shipped
    monkeypatch.setattr(marker_sets, "marker_sets", lambda: shipped | {known.name: known})
    labels = [f"{side} {place}" for side in "LR" for place in ("hip front", "hip back", "knee out", "ankle out")]
    assert marker_sets.identify(["SpineC7", *labels]).name == "example-lab"


def test_the_scenario_passes_the_judge() -> None:
    builder, line = blocks("add-a-scenario.md")
    names = vars(stairs) | vars(bundled)
    exec(builder, names)
    ((stem, build),) = eval(f"{{{line}}}", names).items()
    assert stem not in bundled.BUNDLED
    report = validate_scenario(build(), effector_shapes("talos"))
    assert report.faults == ()
    assert report.duration_s > 10.0


def test_the_estimator_keeps_the_contract_and_is_exact_without_errors(tmp_path: Path) -> None:
    (block,) = blocks("add-an-estimator.md")
    (tmp_path / "double_integral.py").write_text(block, encoding="utf-8")
    estimator = runpy.run_path(str(tmp_path / "double_integral.py"))["DoubleIntegral"]()
    assert isinstance(estimator, ComEstimator)
    motion, t = walk(), np.arange(500) / 100.0
    geometric = motion.geometric(t, np.zeros(3), np.zeros((len(t), 3)))
    found = estimator.estimate(geometric, motion.wrench_track(t, Window(0.5, 4.5)), motion.mass_kg)
    assert np.abs(found.com_m - motion.com.at(found.time_s)).max() < 1e-3


def added(name: str, text: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The names of a new module, which can be imported for the length of a test."""
    module = ModuleType(name)
    monkeypatch.setitem(sys.modules, name, module)
    exec(text, vars(module))
    return vars(module)


def of_file(module: ModuleType, text: str, known: dict[str, Any]) -> dict[str, Any]:
    """The names of a module once ``text`` is in it, and ``known`` is imported there."""
    names = vars(module) | known
    exec(text, names)
    return names


def test_the_job_kind_weighs_the_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    contract, task, work, stage, kind, test = blocks("add-a-job-kind.md")
    schemas = added("stridelab.schemas.weighing", contract, monkeypatch)
    task_model = of_file(tasks, task, schemas)["WeighRecordingTask"]
    monkeypatch.setattr(tasks, "WeighRecordingTask", task_model, raising=False)
    made = added("stridelab.service.kinds.weigh_recording", work, monkeypatch)
    staging = of_file(rows, stage, schemas | {"WeighRecordingTask": task_model})["stage_weigh_recording"]
    monkeypatch.setattr(rows, "stage_weigh_recording", staging, raising=False)
    registered = of_file(registry, kind, schemas)["WEIGH_RECORDING"]
    assert registered.name not in registry.KINDS
    assert registered.run == f"{made['__name__']}:{made['run_in_child'].__name__}"
    names: dict[str, Any] = {
        "shutil": shutil,
        "models_dir": models_dir,
        "pytest": pytest,
        "Path": Path,
        "RecordingSource": tasks.RecordingSource,
    }
    names |= schemas | made
    exec(test, names)
    names["test_the_sample_weighs_what_was_simulated"](tmp_path)
