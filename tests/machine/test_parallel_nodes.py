"""Pieces on a real Dask cluster of two workers: the same answers, and what ends costs its piece alone."""

import asyncio
import os
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pyarrow import parquet

from stridelab.errors import InvalidInput, NotEstimable, StridelabError, Unavailable
from stridelab.machine import cluster
from stridelab.machine.parallel import available_processes, map_in_order, map_isolated, worthwhile_processes
from stridelab.schemas.comparison import BenchMember, ComBenchTask
from stridelab.service.kinds.registry import KINDS
from stridelab.service.processes.landlock import NETWORK_ABI
from stridelab.service.processes.pool import IsolatedPool
from stridelab.service.processes.running_child import IsolatedOutcome
from stridelab.service.processes.sandbox import STRICT, KernelFeatures, Sandbox, confine_piece
from support import parallel_work
from support.command_line import SAMPLE, estimate_task
from support.dask_cluster import DaskCluster, dask_cluster, restart_scheduler, wait_until

PRELOAD = ("support.parallel_work",)


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaskCluster]:
    with dask_cluster(tmp_path_factory.mktemp("dask"), workers=2) as nodes:
        yield nodes


@pytest.fixture
def nodes(running: DaskCluster, monkeypatch: pytest.MonkeyPatch) -> DaskCluster:
    monkeypatch.setenv(cluster.VARIABLE, running.url)
    return running


def noting(folder: Path, n: int, seconds: float) -> list[dict[str, Any]]:
    return [{"n": k, "noted": str(folder), "seconds": seconds} for k in range(n)]


def runs_of(folder: Path) -> Counter[int]:
    """How often each item was started."""
    return Counter(int(path.name.partition("-")[0]) for path in folder.iterdir())


def test_a_failing_item_on_a_node_does_not_affect_the_others(nodes: DaskCluster) -> None:
    hows = ("work", "crash", "exit", "hang", "refuse", "large", "work")
    items = [{"how": how, "n": n} for n, how in enumerate(hows)]
    outcomes = dict(map_isolated(parallel_work.behave, items, preload=PRELOAD, timeout_s=3.0))
    codes = {n: e.code for n, e in outcomes.items() if isinstance(e, StridelabError)}
    assert codes == {
        1: "computation-crashed",
        2: "computation-crashed",
        3: "computation-timed-out",
        4: "no-step",
    }
    assert isinstance(outcomes[4], NotEstimable)
    assert outcomes[4].faults[0].where == "walk.c3d"
    assert wait_until(lambda: not nodes.pieces())


@pytest.mark.usefixtures("nodes")
def test_pieces_come_in_order_from_processes_of_the_nodes() -> None:
    answers = list(map_in_order(parallel_work.square, 11, 2))
    assert [square for square, _ in answers] == [k * k for k in range(11)]
    assert os.getpid() not in {pid for _, pid in answers}
    pieces = list(map_in_order(parallel_work.threads, 4, 2))
    assert {n for threads in pieces for n in threads} == {1}
    with pytest.raises(NotEstimable, match="no posture"):
        list(map_in_order(parallel_work.refuse, 4, 2))
    with pytest.raises(MemoryError):
        list(map_in_order(parallel_work.hog, 2, 2))


@pytest.mark.usefixtures("nodes")
def test_the_number_of_processes_is_that_of_the_cluster() -> None:
    assert available_processes() == 2
    assert (worthwhile_processes(1), worthwhile_processes(1000)) == (1, 2)


def test_a_killed_node_costs_its_item_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = tmp_path / "noted"
    noted.mkdir()
    with dask_cluster(tmp_path, workers=2) as nodes:
        monkeypatch.setenv(cluster.VARIABLE, nodes.url)
        results = map_isolated(parallel_work.note_run, noting(noted, 8, 1.0), preload=PRELOAD)
        answers = [next(results), next(results)]
        assert wait_until(lambda: len(nodes.pieces()) == 2)
        nodes.kill_worker(nodes.workers[0])
        answers += results
    assert sorted(index for index, _ in answers) == list(range(8))
    assert all(answer == {"n": index} for index, answer in answers)
    again = {item: runs for item, runs in runs_of(noted).items() if runs > 1}
    assert list(again.values()) == [2]


def test_a_client_that_is_killed_leaves_no_process_on_a_node(nodes: DaskCluster, tmp_path: Path) -> None:
    items = noting(tmp_path, 6, 600.0)
    program = "from stridelab.machine.parallel import map_isolated; from support.parallel_work import note_run; "
    program += f"list(map_isolated(note_run, {items!r}, preload={PRELOAD!r}))"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    client = subprocess.Popen([sys.executable, "-c", program], env=environment)
    try:
        assert wait_until(lambda: len(nodes.pieces()) == 2)
    finally:
        client.kill()
        client.wait()
    assert wait_until(lambda: not nodes.pieces())
    assert sum(runs_of(tmp_path).values()) == 2


def test_a_lost_scheduler_fails_only_the_unfinished_items(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = tmp_path / "noted"
    noted.mkdir()
    with dask_cluster(tmp_path, workers=2) as nodes:
        monkeypatch.setenv(cluster.VARIABLE, nodes.url)
        results = map_isolated(parallel_work.note_run, noting(noted, 6, 0.5), preload=PRELOAD)
        answers = [next(results), next(results)]
        restart_scheduler(nodes)
        answers += results
    assert sorted(index for index, _ in answers) == list(range(6))
    first = {index for index, _ in answers[:2]}
    assert all(runs_of(noted)[index] == 1 for index in first)


def test_without_a_scheduler_the_computation_fails_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "PATIENCE_S", 0.0)
    monkeypatch.setattr(cluster, "_CONNECT_S", 0.5)
    monkeypatch.setenv(cluster.VARIABLE, "tcp://127.0.0.1:9")
    with pytest.raises(Unavailable) as refusal:
        list(map_isolated(parallel_work.behave, [{"how": "work", "n": 1}], preload=PRELOAD))
    assert refusal.value.code == "cluster-unavailable"
    assert available_processes() == 2


@pytest.mark.parametrize("url", ["head:8786", "tls://head:8786", "tcp://head", "tcp://head:port"])
def test_an_address_of_another_form_is_refused(url: str) -> None:
    with pytest.raises(InvalidInput) as refusal:
        cluster.scheduler_address(url)
    assert refusal.value.code == "dask-url-invalid"


@pytest.mark.usefixtures("nodes")
def test_a_node_reads_copied_files_in_the_sandbox(tmp_path: Path) -> None:
    mine, secret = tmp_path / "mine", tmp_path / "secret"
    (mine / "static").mkdir(parents=True)
    (mine / "walk.c3d").write_text("walk")
    (mine / "static" / "stand.c3d").write_text("stand")
    secret.write_text("of somebody else")
    items = [{"folder": str(mine), "other": str(secret)}]
    ((_, answer),) = map_isolated(parallel_work.read_beside, items, preload=PRELOAD, confine=confine_piece)
    assert isinstance(answer, dict)
    assert answer["files"] == {"walk.c3d": "walk", "static/stand.c3d": "stand"}
    if KernelFeatures.detect_features().landlock_abi:
        assert answer["other"] == "refused"


@pytest.mark.usefixtures("nodes")
def test_a_sweep_is_the_same_in_every_bit_wherever_it_ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from stridelab.schemas.sweeps import SweepInput, SweepTask
    from stridelab.service.kinds.sweep.run import run
    from support.robots.plans import short_walk

    scenario = short_walk()
    job_input = SweepInput(scenario=scenario, vary={"stride": (0.3, 0.9, 3)}, solver="ipopt", node_rate_hz=5.0)
    task = SweepTask(scenario=scenario, input=job_input)
    tables = []
    for name in ("nodes", "here"):
        folder = tmp_path / name
        folder.mkdir()
        summary = run(task, folder, lambda _fraction, _message: None).summary
        assert summary["points"] == 3
        tables.append(repr(parquet.read_table(folder / "sweep.parquet").drop_columns(["solve_time_s"]).to_pydict()))
        monkeypatch.delenv(cluster.VARIABLE, raising=False)
    assert tables[0] == tables[1]
    assert "feasible" in tables[0]


def run_confined(target: str, task: Any, folder: Path, sandbox: Sandbox) -> Any:
    """The value of ``target`` in a child of a worker."""

    async def run() -> IsolatedOutcome:
        async with IsolatedPool([target.partition(":")[0]]) as pool:
            limits: dict[str, Any] = {"timeout_s": 120.0, "memory_mb": 4096}
            return await pool.run(target, task, folder, **limits, low_priority=False, sandbox=sandbox)

    outcome = asyncio.run(run())
    assert outcome.state == "ok", (outcome.problem, outcome.log_tail)
    return outcome.value


def test_a_confined_job_spans_the_nodes_if_its_kind_may(nodes: DaskCluster, tmp_path: Path) -> None:
    kind = KINDS["com-bench"]
    assert kind.spans_nodes
    summaries = []
    for name, sandbox in (("nodes", replace(STRICT, connects=nodes.port)), ("here", STRICT)):
        task = estimate_task(SAMPLE / "recording.c3d", tmp_path / name / "a")
        staged = ComBenchTask(members=[BenchMember(recording_id="a", folder="a", task=task)]).model_dump(mode="json")
        before = nodes.count_transitions()
        summaries.append(run_confined(kind.run, staged, tmp_path / name, sandbox)["summary"])
        assert (nodes.count_transitions() > before) is (name == "nodes")
    assert summaries[0] == summaries[1]


def test_a_confined_job_reaches_one_port_only(
    nodes: DaskCluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    target = "support.parallel_work:connect_to"
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        addresses = {"addresses": [["127.0.0.1", nodes.port], ["127.0.0.1", port]]}
        reachable = run_confined(target, addresses, tmp_path, replace(STRICT, connects=nodes.port))
        strict = run_confined(target, addresses, tmp_path, STRICT)
    assert reachable[f"127.0.0.1:{nodes.port}"] == "connected"
    if KernelFeatures.detect_features().landlock_abi >= NETWORK_ABI:
        assert reachable[f"127.0.0.1:{port}"] == "PermissionError"
    assert set(strict.values()) == {"PermissionError"}


@pytest.mark.usefixtures("nodes")
def test_time_limits_hold_while_others_wait() -> None:
    began_s = time.monotonic()
    items = [{"how": "hang", "n": n} for n in range(2)]
    outcomes = dict(map_isolated(parallel_work.behave, items, preload=PRELOAD, timeout_s=1.0))
    assert {error.code for error in outcomes.values() if isinstance(error, StridelabError)} == {"computation-timed-out"}
    assert time.monotonic() - began_s < 30
