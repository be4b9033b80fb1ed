"""Walks as samples and frames of streams, and raw websockets to send what no client would.

A walk as the samples of a stream, and raw websockets to send what no client would.

The shipped sample as frames of a stream of markers, and raw websockets to send them.
"""

import json
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from stridelab.recordings.reader import read_recording
from stridelab.recordings.recording import Recording
from stridelab.schemas.streams import StreamConfiguration, StreamSample
from support.command_line import SAMPLE
from support.recordings.analytic_motions import walk
from support.service.web_server import Served

RATE_HZ = 200.0
MOTION = walk()
CONFIGURATION = StreamConfiguration(mass_kg=MOTION.mass_kg, rate_hz=RATE_HZ)


def walk_samples(duration_s: float, start_s: float = 0.0) -> list[StreamSample]:
    t = start_s + np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    rows = zip(t.tolist(), *(x.tolist() for x in (MOTION.com.at(t), MOTION.force(t), MOTION.moment(t))), strict=True)
    return [
        StreamSample(time_s=time_s, geometry_m=tuple(g), force_n=tuple(f), moment_nm=tuple(nu))
        for time_s, g, f, nu in rows
    ]


def pack_samples(start_s: float, *rows: tuple[float, ...]) -> bytes:
    """A packed message, written out here once more."""
    return struct.pack("<d", start_s) + b"".join(struct.pack("<10f", *row) for row in rows)


@contextmanager
def socket_of(service: Served, **headers: str) -> Iterator[ClientConnection]:
    address = service.base_url.replace("http", "ws") + "/api/v1/stream/com"
    socket = connect(address, additional_headers=headers, proxy=None, compression=None, max_size=None, close_timeout=1)
    with socket:
        yield socket


def send_configuration(socket: ClientConnection, **fields: Any) -> dict[str, Any]:
    """Send a configuration; returns the answer."""
    socket.send(json.dumps({"mass_kg": MOTION.mass_kg, "rate_hz": RATE_HZ, **fields}))
    return receive_message(socket)


def receive_message(socket: ClientConnection) -> dict[str, Any]:
    answer = json.loads(socket.recv(timeout=60))
    assert isinstance(answer, dict)
    return answer


def receive_close(socket: ClientConnection) -> tuple[int, str]:
    """Code and reason with which the service closes; nothing else may come before."""
    with pytest.raises(ConnectionClosed) as closed:
        socket.recv(timeout=60)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, closed.value.rcvd.reason


PATH = "/api/v1/stream/markers"


@cache
def sample() -> Recording:
    return read_recording(SAMPLE / "recording.c3d")


def header(**fields: Any) -> dict[str, Any]:
    """Header of the shipped sample."""
    recording = sample()
    return {
        "labels": list(recording.markers_m),
        "rate_hz": recording.marker_rate_hz,
        "person": {"mass_kg": recording.subject.mass_kg, "height_m": recording.subject.height_m, "sex": "female"},
        "plates": [{"corners": plate.corners_m.tolist()} for plate in recording.plates],
        **fields,
    }


def at_markers(track: np.ndarray) -> np.ndarray:
    """A track of the plates at the instants of the markers."""
    recording = sample()
    read_s = np.arange(len(track)) / recording.force_rate_hz
    return np.column_stack([np.interp(recording.time_s, read_s, track[:, axis]) for axis in range(3)])


@cache
def _plate_tracks() -> list[tuple[np.ndarray, np.ndarray]]:
    return [(at_markers(plate.force_n), at_markers(plate.moment_nm)) for plate in sample().plates]


def frame(k: int, **fields: Any) -> dict[str, Any]:
    """Frame ``k`` of the shipped sample."""
    recording = sample()
    return {
        "t_s": float(recording.time_s[k]),
        "markers": [track[k].tolist() for track in recording.markers_m.values()],
        "plates": [{"force_n": f[k].tolist(), "moment_nm": nu[k].tolist()} for f, nu in _plate_tracks()],
        **fields,
    }


@contextmanager
def marker_socket(service: Served, path: str = PATH, **headers: str) -> Iterator[ClientConnection]:
    address = service.base_url.replace("http", "ws") + path
    socket = connect(address, additional_headers=headers, proxy=None, compression=None, max_size=None, close_timeout=1)
    with socket:
        yield socket


def receive_reply(socket: ClientConnection) -> dict[str, Any]:
    answer = json.loads(socket.recv(timeout=60))
    assert isinstance(answer, dict)
    return answer


def send_header(socket: ClientConnection, **fields: Any) -> dict[str, Any]:
    """Send a header; returns the answer."""
    socket.send(json.dumps(header(**fields)))
    return receive_reply(socket)


def send_frames(socket: ClientConnection, frames: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Send frames one by one; returns their answers."""
    replies = []
    for item in frames:
        socket.send(json.dumps(item))
        replies.append(receive_reply(socket))
    return replies
