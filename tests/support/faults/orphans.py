"""How long a job of a killed worker waits until another one starts it: ``python -m support.faults.orphans [KILLS]``.

Two workers on a database of their own; whichever runs the job is killed with SIGKILL and its job looked at until the
other has started it again. Once with the settings that tests use, once with those of the service.
"""

import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from stridelab.service.settings import Settings
from support.service.database import databases
from support.service.processes import BRISK, Jobs, worker

_SERVICE = Settings.model_fields
SETTINGS = {
    "of the tests": BRISK,
    "of the service": {
        "STRIDELAB_HEARTBEAT_S": str(_SERVICE["heartbeat_s"].default),
        "STRIDELAB_STALL_S": str(_SERVICE["stall_s"].default),
    },
}


def delay_s(url: str, settings: dict[str, str], folder: Path) -> float:
    """Seconds from the kill of a worker to the second start of its job."""
    jobs = Jobs(url)
    with ExitStack() as stack:
        pair = {name: stack.enter_context(worker(url, folder / name, **settings)) for name in "ab"}
        beat_s = float(settings["STRIDELAB_HEARTBEAT_S"])
        time.sleep(2.0 * beat_s + 3.0)  # a worker that has just come takes nobody's job
        job_id = jobs.submit("long-work", work_s=600.0, diary=str(folder / "diary"), name="orphan")
        jobs.until_running(job_id)
        holder = next(name for name in pair if any((folder / name / "work").glob("*/*/")))
        pair[holder].kill()
        began = time.monotonic()
        jobs.until(job_id, lambda seen: seen.attempt == 2 and seen.message.startswith("step"), timeout_s=120.0)
        took_s = time.monotonic() - began
        jobs.ask(lambda store: store.request_cancel(job_id))
        return took_s


def main(kills: int) -> None:
    """Print the delays."""
    with databases() as server, tempfile.TemporaryDirectory() as scratch:
        for name, settings in SETTINGS.items():
            with server.fresh() as url:
                found = [delay_s(url, dict(settings), Path(scratch, f"{name} {k}")) for k in range(kills)]
            sys.stdout.write(f"settings {name}: {', '.join(f'{s:.1f}' for s in sorted(found))} s\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)
