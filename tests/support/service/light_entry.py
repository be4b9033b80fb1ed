"""Serves calls of the robot wing in one process; prints their statuses and the heavy packages that it imported."""

import json
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


def main(database_url: str, data: Path) -> None:
    with served(database_url, data) as service, service.http() as http:
        service.run(scenarios.seed_scenarios(service.parts.engine))
        statuses = [http.request(method, f"/api/v1/{path}", json=body).status_code for method, path, body in CALLS]
    print(json.dumps({"statuses": statuses, "heavy": sorted(HEAVY & set(sys.modules))}))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
