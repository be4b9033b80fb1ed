"""Starting, stopping and refusing to start."""

import signal
import socket
import subprocess
import sys
from pathlib import Path

from support.service.database import public_folder
from support.service.processes import Service, environment, wait_for_exit, wait_until


def test_ctrl_c_ends_everything_and_the_next_start_finds_everything() -> None:
    with public_folder() as folder:
        service = Service(folder / "data with space")
        service.start()
        job_id = service.jobs.submit("work")
        assert service.jobs.until_final(job_id).state == "succeeded"
        spinning = service.jobs.submit("spin")
        service.jobs.until(spinning, lambda record: record.message.startswith("pid"))
        members = service.members()
        assert service.stop(signal.SIGINT) < 5.0
        assert service.process is not None
        assert service.process.returncode == 0
        wait_until(lambda: all(wait_for_exit(process) for process in members), 20, "everything ended")

        service.start()
        try:
            assert service.jobs.get(job_id).state == "succeeded"
            again = service.jobs.until(spinning, lambda record: record.message.startswith("pid"))
            assert again.attempt == 2  # handed back, taken up again
            members = service.members()
            assert len(members) >= 6  # supervisor, web server, worker, postmaster, children of both
        finally:
            service.stop(signal.SIGKILL)
        wait_until(
            lambda: all(wait_for_exit(process) for process in members), 20, "everything ended with the supervisor"
        )


def refused(**settings: str) -> str:
    """What a service that does not start says."""
    result = subprocess.run(
        [sys.executable, "-m", "support.service.supervisor_entry"],
        env=environment(**settings),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert result.returncode == 1
    assert "Traceback" not in result.stderr
    return result.stderr


def test_taken_port_is_one_clear_line(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        line = refused(STRIDELAB_PORT=port, STRIDELAB_DATA_DIR=str(tmp_path / "data"))
    assert line.startswith(f"port-taken: Port {port}")
    assert "STRIDELAB_PORT" in line
    assert len(line.strip().splitlines()) == 1
    assert not (tmp_path / "data").exists()


def test_open_address_needs_a_token(tmp_path: Path) -> None:
    line = refused(STRIDELAB_HOST="0.0.0.0", STRIDELAB_DATA_DIR=str(tmp_path / "data"))
    assert line.startswith("token-needed")
    assert "STRIDELAB_API_TOKEN" in line
    assert not (tmp_path / "data").exists()


def test_binaries_that_cannot_run_are_named(tmp_path: Path) -> None:
    line = refused(STRIDELAB_PG_BIN=str(tmp_path), STRIDELAB_DATA_DIR=str(tmp_path / "data"))
    assert "STRIDELAB_DATABASE_URL" in line
    assert "STRIDELAB_PG_BIN" in line
    assert [path.name for path in (tmp_path / "data").iterdir()] == ["supervisor.lock"]
