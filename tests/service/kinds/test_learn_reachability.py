"""The job leaves densities that can be read back, a card, and the samples; what it cannot do it refuses by name."""

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from threadpoolctl import threadpool_limits

from stridelab.errors import NotFound
from stridelab.machine.parallel import worthwhile_processes
from stridelab.reachability import store
from stridelab.reachability.learning.fit import learn_densities
from stridelab.robots.loader import load_robot
from stridelab.schemas.robots import LearnReachabilitySummary
from stridelab.service.kinds.learn_reachability.run import run
from stridelab.service.kinds.provenance import known_references
from stridelab.service.kinds.registry import KINDS
from stridelab.service.kinds.result_tables import read_metadata
from stridelab.service.processes.child import with_json
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome

SCRIPT = Path(__file__).parents[3] / "scripts" / "make_reachability.py"
REQUEST: dict[str, Any] = {"robot": "talos", "effectors": ["left_foot", "right_hand"], "samples": 500, "seed": 4}


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """As in the child."""
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("learned")


@pytest.fixture(scope="module")
def outcome(folder: Path) -> dict:
    fractions: list[float] = []
    result = with_json(run)({"input": REQUEST}, folder, lambda fraction, _: fractions.append(fraction))
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    return result


def test_the_registry_runs_it() -> None:
    assert KINDS["learn-reachability"].run == f"{run.__module__}:{run.__name__}"


def test_the_summary_is_that_of_the_contract(outcome: dict) -> None:
    summary = LearnReachabilitySummary.model_validate(outcome["summary"])
    assert summary.robot_sha256 == load_robot("talos").sha256
    assert (summary.samples, summary.measure) == (500, "uniform")
    assert summary.tried > 500
    assert summary.rejected_share == pytest.approx(1 - 500 / summary.tried)
    assert 1 <= summary.effectors["left_foot"].components <= 20
    assert (summary.effectors["left_foot"].thesis_components, summary.effectors["left_foot"].frame) == (7, "contact")
    assert summary.effectors["right_hand"].thesis_components == 14
    assert "few-samples" in {remark.code for remark in summary.warnings}
    assert set(outcome["references"]) <= known_references()


def test_the_mixtures_are_those_of_the_same_seed(outcome: dict, folder: Path) -> None:
    card = store.read_card(folder / "mixtures.json")
    day = date.fromisoformat(card.learned_on)
    assert card == learn_densities(load_robot("talos"), day, REQUEST["effectors"], 500, 4).card
    assert card.effectors["left_foot"].kl_nats == outcome["summary"]["effectors"]["left_foot"]["kl_nats"]


def test_the_card_holds_everything_but_the_mixtures(outcome: dict, folder: Path) -> None:
    card = json.loads((folder / "card.json").read_text(encoding="utf-8"))
    whole = json.loads((folder / "mixtures.json").read_text(encoding="utf-8"))
    for effector in whole["effectors"].values():
        for numbers in ("weights", "means", "covariances"):
            del effector[numbers]
    assert card == whole
    assert card["seed"] == 4
    assert len(card["effectors"]["left_foot"]["sizes"]) == 20


def test_the_samples_are_a_table_with_its_twin(outcome: dict, folder: Path) -> None:
    table = pq.read_table(folder / "samples.parquet")
    columns = [f"{name}_com_{axis}_m" for name in REQUEST["effectors"] for axis in "xyz"]
    assert table.column_names == columns == pyarrow.csv.read_csv(folder / "samples.csv").column_names
    assert table.num_rows == 500
    x = np.column_stack([table[name].to_numpy() for name in columns[:3]])
    reach = store.read_card(folder / "mixtures.json").effectors["left_foot"].reach
    assert np.linalg.norm(x, axis=1).max() == pytest.approx(reach.com_distance_max_m)
    about = read_metadata(folder / "samples.parquet")
    assert about["units"][columns[0]] == "m"
    assert about["provenance"]["input"]["seed"] == 4


def test_every_file_is_an_artifact(outcome: dict, folder: Path) -> None:
    names = {artifact["name"] for artifact in outcome["artifacts"]}
    assert names == {
        "mixtures.json", "cloud.npz", "card.json", "reachability.json", "samples.parquet", "samples.csv",
    }  # fmt: skip
    assert names == {path.name for path in folder.iterdir()}


def test_the_script_writes_the_bytes_of_the_job(tmp_path: Path) -> None:
    """The files that are bundled: same robot, measure, samples, seed and day, another number of processes."""
    job_input = {"robot": "talos", "samples": 700, "seed": 2}
    with_json(run)({"input": job_input}, tmp_path, lambda *_: None)
    day = store.read_card(tmp_path / "mixtures.json").learned_on
    options = ["--samples", "700", "--seed", "2", "--date", day, "--processes", "2", "--folder", str(tmp_path)]
    subprocess.run([sys.executable, str(SCRIPT), "talos", "uniform", *options], check=True)
    assert (tmp_path / "talos" / "uniform.json").read_bytes() == (tmp_path / "mixtures.json").read_bytes()
    assert (tmp_path / "talos" / "uniform.npz").read_bytes() == (tmp_path / "cloud.npz").read_bytes()


def test_the_other_measure_learns_from_stances(tmp_path: Path) -> None:
    job_input = {"robot": "talos", "effectors": ["left_foot"], "samples": 500, "measure": "conditioned"}
    result = with_json(run)({"input": job_input}, tmp_path, lambda *_: None)
    assert result["summary"]["measure"] == "conditioned"
    assert result["summary"]["effectors"]["left_foot"]["mode_m"][2] > 0.45, "well above a folded posture's 0.13"


def test_a_cancelled_job_leaves_no_process_behind(tmp_path: Path) -> None:
    """As many processes as pay draw the postures; they are in the session of the job's child."""
    before = {p.pid for p in psutil.Process().children(recursive=True)}
    pids: set[int] = set()

    async def cancelled() -> IsolatedOutcome:
        cancel = asyncio.Event()

        def on_progress(fraction: float, _message: str) -> None:
            pids.update(p.pid for p in psutil.Process().children(recursive=True) if p.pid not in before)
            if fraction > 0.05:
                cancel.set()

        async with IsolatedPool() as pool:
            target, task = KINDS["learn-reachability"].run, {"input": {"robot": "talos"}}
            kind = KINDS["learn-reachability"]
            limits: dict = {"timeout_s": 600.0, "memory_mb": kind.memory_mb, "sandbox": kind.sandbox}
            return await pool.run(target, task, tmp_path, **limits, cancel=cancel, on_progress=on_progress)

    assert asyncio.run(cancelled()).state == "cancelled"
    assert len(pids) > worthwhile_processes(10)
    end = time.monotonic() + 10.0
    while (remaining := [pid for pid in pids if psutil.pid_exists(pid)]) and time.monotonic() < end:
        time.sleep(0.05)
    assert remaining == []


@pytest.mark.parametrize(
    ("change", "code"),
    [({"robot": "nao"}, "robot-not-found"), ({"effectors": ["left_foot", "tail"]}, "effector-not-found")],
)
def test_unknown_robots_and_effectors_are_named(change: dict, code: str, tmp_path: Path) -> None:
    with pytest.raises(NotFound) as refusal:
        with_json(run)({"input": REQUEST | change}, tmp_path, lambda *_: None)
    assert refusal.value.code == code
    assert not list(tmp_path.iterdir())
