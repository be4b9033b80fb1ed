"""A service with tokens and its viewer, as two programs that talk over the loopback."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from support.service.database import TestDatabases
from support.service.web_server import Served, served

ADMIN = "a-secret-of-the-lab"


@dataclass(frozen=True)
class Lab:
    """A service with its viewer; ``admin`` speaks with the token of the settings."""

    served: Served
    admin: httpx.Client

    def token(self, name: str, scope: str) -> dict[str, Any]:
        answer = self.admin.post("/api/v1/tokens", json={"name": name, "scope": scope})
        assert answer.status_code == 201, answer.text
        return dict(answer.json())

    def http(self, secret: str) -> httpx.Client:
        return self.served.http(headers={"Authorization": f"Bearer {secret}"})

    def wait_until_prepared(self, robot: str) -> None:
        """Until then the viewer's pages show how far the robot's files are."""
        while (found := self.admin.get(f"/api/v1/robots/{robot}/preparation").json())["state"] == "preparing":
            time.sleep(0.1)
        assert found["state"] == "ready", found

    def audited(self, scenario_id: str) -> list[tuple[str, str]]:
        items = self.admin.get("/api/v1/audit").json()["items"]
        return [(item["action"], item["caller"]) for item in items if item["what"] == scenario_id]


@contextmanager
def viewer_lab(postgres: TestDatabases, data: Path, **environment: str) -> Iterator[Lab]:
    """Such a service with an empty database; ``environment`` is the viewer's."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        viewer_url = f"http://127.0.0.1:{taken.getsockname()[1]}"
    with postgres.fresh() as url, served(url, data, api_token=ADMIN, viewer_url=viewer_url) as running:
        given = {
            **os.environ,
            "STRIDELAB_API_TOKEN": ADMIN,
            "STRIDELAB_HOST": "127.0.0.1",
            "STRIDELAB_PORT": running.base_url.rpartition(":")[2],
            "STRIDELAB_VIEWER_URL": viewer_url,
            **environment,
        }
        viewer = subprocess.Popen([sys.executable, "-m", "stridelab_web.viewer"], env=given)
        try:
            with running.http(headers={"Authorization": f"Bearer {ADMIN}"}, timeout=120) as admin:
                yield Lab(running, admin)
        finally:
            viewer.terminate()
            viewer.wait(20)
