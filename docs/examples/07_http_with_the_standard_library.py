"""The robot wing with Python's standard library alone: take a scenario, move a foothold, ask the judge, plan.

Usage: 07_http_with_the_standard_library.py [http://127.0.0.1:8000], where ``make serve`` runs.
"""

import json
import sys
from typing import Any
from urllib.request import Request, urlopen

API = f"{sys.argv[1] if len(sys.argv) > 1 else 'http://127.0.0.1:8000'}/api/v1"


def call(path: str, body: Any = None) -> Any:
    """The answer to a GET, or with a body to a POST; what is refused raises ``HTTPError``."""
    data = None if body is None else json.dumps(body).encode()
    with urlopen(Request(API + path, data, {"Content-Type": "application/json"}), timeout=90) as answer:
        return json.load(answer)


known = call("/scenarios/flat-walk")
scenario = {key: known[key] for key in ("description", "robot", "friction", "terrain", "phases")}
scenario["name"] = "Flat walk, with one foothold moved"


def shift(phases: list[Any], effector: str, by_m: tuple[float, float, float]) -> None:
    """Move the place of ``effector`` in these phases."""
    for contact in (contact for phase in phases for contact in phase["contacts"] if contact["effector"] == effector):
        contact["position_m"] = [x + dx for x, dx in zip(contact["position_m"], by_m, strict=True)]


phases = scenario["phases"]
standing = [{contact["effector"] for contact in phase["contacts"]} for phase in phases]
(foot,) = standing[0] - standing[1]  # the first to step; it lands in phase 2
until = next(i for i in range(2, len(phases)) if foot not in standing[i])
for by_m in ((0.0, 0.0, 0.2), (0.02, 0.0, -0.2)):  # 20 cm up, where nothing is to stand on; back, and 2 cm on
    shift(phases[2:until], foot, by_m)
    verdict = call("/scenarios/check", scenario)
    print("the judge:", "possible" if verdict["valid"] else verdict["errors"][0]["message"])

job = call("/jobs/plan-motion", {"scenario": scenario, "whole_body": False})
while job["state"] in ("queued", "running"):
    job = call(f"/jobs/{job['id']}?wait=30")
if job["state"] != "succeeded":
    sys.exit(f"{job['state']}: {job['error']}")
summary = call(f"/jobs/{job['id']}/result")["summary"]
print(f"{summary['solver']} planned {summary['duration_s']:.1f} s in {summary['iterations']} iterations")
