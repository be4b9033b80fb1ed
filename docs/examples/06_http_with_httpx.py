"""The human wing over HTTP alone: upload a recording, estimate, download; nothing of stridelab is imported.

Usage: 06_http_with_httpx.py [http://127.0.0.1:8000], where ``make serve`` runs and walk.c3d is (the first example
writes one). With ``requests`` in the place of ``httpx`` the lines are the same but for the Client.
"""

import sys
from pathlib import Path

import httpx

service = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8000"
with httpx.Client(base_url=f"{service}/api/v1", timeout=90.0) as http:
    with Path("walk.c3d").open("rb") as file:
        answer = http.post("/recordings", files={"file": file}, data={"height_m": "1.71", "sex": "female"})
    if answer.status_code == 422:  # every refusal is a problem+json: a code, a sentence, the places
        sys.exit(answer.json()["detail"])
    recording = answer.raise_for_status().json()
    print(f"{recording['filename']}: markers of {recording['marker_set']}, force in {recording['windows_s']} s")

    task = {"recording_id": recording["id"], "method": "smoother"}
    job = http.post("/jobs/estimate-com", json=task).raise_for_status().json()
    while job["state"] in ("queued", "running"):
        job = http.get(f"/jobs/{job['id']}", params={"wait": 30}).raise_for_status().json()
    if job["state"] != "succeeded":
        sys.exit(f"{job['state']}: {job['error']}")

    summary = http.get(f"/jobs/{job['id']}/result").raise_for_status().json()["summary"]
    print(f"{summary['method']} over {summary['window_s']} s, force late by {1e3 * summary['latency_s']:.1f} ms")
    table = http.get(f"/jobs/{job['id']}/artifacts/com.csv").raise_for_status()
    Path("com.csv").write_bytes(table.content)
    print(f"com.csv: {len(table.text.splitlines()) - 1} frames")
