"""The process that serves the interface computes nothing: what is heavy is imported by children only."""

import json
import os
import subprocess
import sys
from pathlib import Path


def test_serving_robots_and_scenarios_imports_nothing_heavy(database_url: str, tmp_path: Path) -> None:
    served = subprocess.run(
        [sys.executable, "-m", "support.service.light_entry", database_url, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert served.returncode == 0, served.stderr[-3000:]
    found = json.loads(served.stdout.splitlines()[-1])
    assert found["statuses"] == [200, 200, 200, 201, *5 * [202], 200, 422, 202, 202, 200, 404, 200, 200]
    assert found["heavy"] == []
