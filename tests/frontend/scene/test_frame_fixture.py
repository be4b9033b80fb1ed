"""The unit tests of the JavaScript decoder read a file that the Python encoder wrote; it is the one of today."""

import base64
import json
from pathlib import Path

import numpy as np

from stridelab_web.scene.frames import Arrow, Body, Ellipsoid, Frames, Point

FIXTURE = Path(__file__).parents[1] / "js" / "frames.json"
N = 12


def fixture_frames() -> Frames:
    """A point with a gap, a turning body, a force and semi-axes: every step that a column can have."""
    time_s = np.arange(N) / 50
    half = np.pi * time_s
    point = np.column_stack([np.sin(time_s), -2 * time_s, 0.1 + time_s**2])
    point[4:6] = np.nan
    pose = np.column_stack([time_s, 0 * time_s, 1 + 0 * time_s, np.cos(half), 0 * half, 0 * half, np.sin(half)])
    force = np.column_stack([0.3 * time_s, 0 * time_s, 1 + 0 * time_s, 12 - 90 * time_s, 5 + 0 * time_s, 700 + time_s])
    axes = np.column_stack([1e-3 + 0 * time_s, 2e-3 + 1e-3 * time_s, 5e-4 + 0 * time_s])
    return Frames(
        time_s,
        np.column_stack([point, pose, force, axes]).astype(np.float32),
        points=(Point("/points/heel", 0, "heel"),),
        bodies=(Body("/robot/pelvis", 3),),
        arrows=(Arrow("/forces/left", "/forces/left/head", 10, "left"),),
        ellipsoids=(Ellipsoid("/com/spread", 0, 16),),
        phase_starts_s=(0.0, 0.1),
    )


def fixture_text() -> str:
    """The encoded file, and the values that went into it."""
    frames = fixture_frames()
    values = [[None if np.isnan(v) else float(v) for v in row] for row in frames.values]
    return json.dumps({"file": base64.b64encode(frames.to_bytes()).decode(), "values": values}, indent=1) + "\n"


def test_fixture_of_the_decoder_is_what_the_encoder_writes() -> None:
    assert FIXTURE.read_text(encoding="utf-8") == fixture_text(), f"write fixture_text() into {FIXTURE.name}"
    assert FIXTURE.stat().st_size < 20_000
