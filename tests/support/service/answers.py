"""Reading answers of the interface in tests."""

import httpx


def refusal(answer: httpx.Response) -> tuple[int, str]:
    """Status and code of an answer that must be a problem."""
    assert answer.headers["content-type"] == "application/problem+json", answer.text
    return answer.status_code, answer.json()["code"]


def places(answer: httpx.Response) -> list[str]:
    """Where a problem says that something is wrong."""
    return [fault["where"] for fault in answer.json()["errors"]]


def upload(http: httpx.Client, content: bytes, name: str = "walk.c3d", **fields: str) -> httpx.Response:
    """Upload ``content`` as a file called ``name``."""
    return http.post("/api/v1/recordings", files={"file": (name, content)}, data=fields)
