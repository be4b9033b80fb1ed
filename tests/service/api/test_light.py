"""The process that serves the interface computes nothing: what is heavy is imported by children only.

Run as a program, this module makes calls of the robot wing to a service in its own process.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from stridelab.service.samples import scenarios
from stridelab.service.samples.scenario_bodies import IN_THE_AIR, ONE_STEP, STANDING
from support.service.web_server import served

HEAVY = {"pinocchio", "coal", "casadi", "sklearn", "skimage", "mujoco", "daqp", "trimesh", "ezc3d"}
CALLS = [
    ("GET", "scenarios", None),
    ("GET", "scenarios/flat-walk", None),
    ("POST", "scenarios/check", IN_THE_AIR),
    ("POST", "scenarios", ONE_STEP),
    ("POST", "jobs/plan-motion", {"scenario": ONE_STEP}),
    ("POST", "jobs/plan-motion", {"scenario_id": "flat-walk"}),
    ("POST", "jobs/plan-receding", {"scenario": ONE_STEP}),
    ("POST", "jobs/push-basin", {"scenario": ONE_STEP, "speed_m_s": 0.2}),
    ("POST", "jobs/sweep", {"scenario": ONE_STEP, "vary": {"stride": [0.1, 0.3, 3]}}),
    ("GET", "solvers", None),
    ("POST", "plans/preview", {"scenario": ONE_STEP, "push": {"time_s": 90.0, "velocity_m_s": [0.0, 0.1, 0.0]}}),
    ("POST", "jobs/learn-reachability", {"robot": "talos"}),
    (
        "POST",
        "jobs/plan-contacts",
        {"robot": "talos", "terrain": ONE_STEP["terrain"], "start": STANDING, "goal": STANDING},
    ),
    ("GET", "robots", None),
    ("GET", "robots/nao", None),
    ("GET", "robots/talos", None),
    ("GET", "robots/talos/reachability?measure=uniform", None),
]


def serve_all(database_url: str, data: Path) -> None:
    """Make the calls in this process; print their statuses and the heavy packages that it imported."""
    with served(database_url, data) as service, service.http() as http:
        service.run(scenarios.seed_scenarios(service.parts.engine))
        statuses = [http.request(method, f"/api/v1/{path}", json=body).status_code for method, path, body in CALLS]
    print(json.dumps({"statuses": statuses, "heavy": sorted(HEAVY & set(sys.modules))}))


def test_serving_robots_and_scenarios_imports_nothing_heavy(database_url: str, tmp_path: Path) -> None:
    served = subprocess.run(
        [sys.executable, __file__, database_url, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert served.returncode == 0, served.stderr[-3000:]
    imported = json.loads(served.stdout.splitlines()[-1])
    assert imported["statuses"] == [200, 200, 200, 201, *5 * [202], 200, 422, 202, 202, 200, 404, 200, 200]
    assert imported["heavy"] == []


if __name__ == "__main__":
    serve_all(sys.argv[1], Path(sys.argv[2]))
