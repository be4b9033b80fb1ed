"""Readers of bulk uploads that were taken over, and do not tell the truth to the web server."""

from pathlib import Path
from typing import Any

from stridelab.service.kinds.read_batch import run as read_batch


def claim_another_file(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """A reader of bulk uploads that gives a file of the machine for one that was sent."""
    found = read_batch.parse_batch(task, folder, progress)
    found["files"][0]["file"] = "/etc/hostname"
    return found


def claim_another_hash(task: dict[str, Any], folder: Path, progress: Any) -> dict[str, Any]:
    """One that says of a file that it is another, which is stored already."""
    found = read_batch.parse_batch(task, folder, progress)
    found["files"][0]["sha256"] = "ab" * 32
    return found
