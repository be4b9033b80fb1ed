"""A walk as the samples of a stream, and raw websockets to send what no client would."""

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from stridelab.schemas.streams import StreamConfiguration, StreamSample
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


def packed(start_s: float, *rows: tuple[float, ...]) -> bytes:
    """A packed message, written out here once more."""
    return struct.pack("<d", start_s) + b"".join(struct.pack("<10f", *row) for row in rows)


@contextmanager
def socket_of(service: Served, **headers: str) -> Iterator[ClientConnection]:
    address = service.base_url.replace("http", "ws") + "/api/v1/stream/com"
    socket = connect(address, additional_headers=headers, proxy=None, compression=None, max_size=None, close_timeout=1)
    with socket:
        yield socket


def configure(socket: ClientConnection, **fields: Any) -> dict[str, Any]:
    """Send a configuration; returns the answer."""
    socket.send(json.dumps({"mass_kg": MOTION.mass_kg, "rate_hz": RATE_HZ, **fields}))
    return heard(socket)


def heard(socket: ClientConnection) -> dict[str, Any]:
    answer = json.loads(socket.recv(timeout=60))
    assert isinstance(answer, dict)
    return answer


def goodbye(socket: ClientConnection) -> tuple[int, str]:
    """Code and reason with which the service closes; nothing else may come before."""
    with pytest.raises(ConnectionClosed) as closed:
        socket.recv(timeout=60)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, closed.value.rcvd.reason
