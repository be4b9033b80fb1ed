"""What the how-tos add is added here, from their own lines, for the length of a test."""

import importlib
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import APIRouter, FastAPI
from fastapi.routing import APIRoute
from sqlalchemy.ext.asyncio import AsyncEngine

from experiments import bundled_scenarios as bundled
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios import stairs
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.estimation.estimator import ComEstimator
from stridelab.machine.models_folder import models_dir
from stridelab.recordings.marker_sets import identify, marker_sets, parse_marker_set
from stridelab.recordings.recording import Window
from stridelab.schemas.tasks import RecordingSource
from stridelab.service import kinds
from stridelab.service.api.jobs import submit
from stridelab.service.kinds import registry
from stridelab.service.processes.child import with_json
from stridelab.service.samples.recording import seed_sample
from stridelab.service.storage.blobs import BlobStore
from support.recordings.analytic_motions import walk
from support.service import database

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to"


def blocks(page: str) -> list[str]:
    """Code of a page that is no shell, in order."""
    text = (HOW_TO / page).read_text(encoding="utf-8")
    matches = re.findall(r"^( *)```(?:python|toml|text)\n(.*?)^ *```$", text, re.MULTILINE | re.DOTALL)
    return [re.sub(rf"^{indent}", "", block, flags=re.MULTILINE) for indent, block in matches]


def test_the_marker_set_is_read_and_recognised() -> None:
    (block,) = blocks("add-a-marker-set.md")
    known = parse_marker_set(tomllib.loads(block), "example")
    assert known.name not in marker_sets()
    labels = [f"{side} {place}" for side in "LR" for place in ("hip front", "hip back", "knee out", "ankle out")]
    assert identify(["SpineC7", *labels], own_sets=[known]).name == "example-lab"


def test_the_scenario_passes_validation() -> None:
    *_, builder, line = blocks("add-a-scenario.md")  # the last section adds a scenario to the program
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
    estimate = estimator.estimate(geometric, motion.wrench_track(t, Window(0.5, 4.5)), motion.mass_kg)
    assert np.abs(estimate.com_m - motion.com.at(estimate.time_s)).max() < 1e-3


@pytest.fixture
def kind_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of job kinds beside the program's, with the one of the how-to; its modules are forgotten at the end."""
    kind, run, _ = blocks("add-a-job-kind.md")
    folder = tmp_path / "kinds" / "weigh_recording"
    folder.mkdir(parents=True)
    for name, text in {"__init__": "", "kind": kind, "run": run}.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(kinds, "__path__", [*kinds.__path__, str(folder.parent)])
    yield folder
    vars(kinds).pop(folder.name, None)
    for name in [name for name in sys.modules if name.startswith(f"{kinds.__name__}.{folder.name}")]:
        del sys.modules[name]


def test_the_job_kind_is_discovered_and_described(kind_files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds_in_folder = registry.discover_kinds(kinds)
    assert set(kinds_in_folder) - set(registry.KINDS) == {"weigh-recording"}
    monkeypatch.setattr(submit, "KINDS", kinds_in_folder)
    app, router = FastAPI(), APIRouter(prefix="/jobs")
    submit.add_kinds(router)
    app.include_router(router)
    operation = app.openapi()["paths"]["/jobs/weigh-recording"]["post"]
    kind = kinds_in_folder["weigh-recording"]
    assert operation["description"].startswith(f"{kind.title}. {kind.description} ")
    assert operation["requestBody"]["content"]["application/json"]["examples"] == kind.examples
    routes = [route for route in router.routes if isinstance(route, APIRoute)]
    endpoint = next(route.endpoint for route in routes if route.path == "/jobs/weigh-recording")
    assert signature(endpoint).parameters["body"].annotation.__origin__ is kind.input_model


def test_describing_the_job_kind_imports_no_numerics(kind_files: Path) -> None:
    code = (
        f"import sys, stridelab.service.kinds as kinds; kinds.__path__.append({str(kind_files.parent)!r});"
        "from stridelab.service.kinds.registry import COMPUTING, KINDS; assert 'weigh-recording' in KINDS;"
        "assert 'stridelab.service.kinds.weigh_recording.run' in COMPUTING;"
        "print(sorted({'numpy', 'scipy', 'ezc3d', 'pinocchio', 'pyarrow'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_the_job_kind_weighs_the_stored_sample(kind_files: Path, database_url: str, tmp_path: Path) -> None:
    """From its own example over the staging of the worker to the function that the child calls."""
    kind = registry.discover_kinds(kinds)["weigh-recording"]
    (example,) = kind.examples.values()
    store = BlobStore.from_url((tmp_path / "blobs").as_uri())
    (folder := tmp_path / "task").mkdir()

    async def act(engine: AsyncEngine) -> Any:
        await seed_sample(engine, store)
        async with engine.begin() as connection:
            return await kind.stage(connection, store, kind.input_model.model_validate(example["value"]), folder)

    module, _, function = kind.run.partition(":")
    task = database.run_with_engine(database_url, act)
    outcome = with_json(getattr(importlib.import_module(module), function))(task, folder, lambda _share, _message: None)
    assert outcome["summary"]["mass_kg"] == pytest.approx(60.0, rel=0.03)
    assert len(outcome["summary"]["largest_force_n"]) == 2


def test_the_test_of_the_job_kind_passes(kind_files: Path, tmp_path: Path) -> None:
    names: dict[str, Any] = {"shutil": shutil, "models_dir": models_dir, "pytest": pytest, "Path": Path}
    names["RecordingSource"] = RecordingSource
    for name in ("kind", "run"):
        names |= vars(importlib.import_module(f"{kinds.__name__}.{kind_files.name}.{name}"))
    exec(blocks("add-a-job-kind.md")[-1], names)
    names["test_the_sample_weighs_what_was_simulated"](tmp_path)
