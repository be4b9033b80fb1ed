"""Both clients on a real stream."""

import asyncio
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from websockets.sync.server import ServerConnection, serve

from stridelab.client import AsyncClient, Client, ClientError, ProblemError, Unreachable
from stridelab.client.streams import Address, decode_estimates, encode_samples
from stridelab.schemas.streams import StreamConfiguration, StreamSample
from support.service.streams import CONFIGURATION, MOTION, RATE_HZ, pack_samples, walk_samples
from support.service.web_server import Served

SAMPLES = walk_samples(0.5)
PACKED = CONFIGURATION.model_copy(update={"format": "float32"})


def test_the_synchronous_client_streams(lab: Client) -> None:
    with lab.stream_com(PACKED) as stream:
        assert stream.ready.format == "float32"
        estimates = [stream.send([sample])[0] for sample in SAMPLES[:5]] + stream.send(SAMPLES[5:])
    t = np.array([sample.time_s for sample in SAMPLES])
    assert [estimate.time_s for estimate in estimates] == pytest.approx(t, abs=1e-6)
    assert np.abs(np.array([estimate.com_m for estimate in estimates]) - MOTION.com.at(t)).max() < 0.01


@pytest.mark.anyio
async def test_the_asynchronous_client_streams_beside_other_calls(service: Served) -> None:
    async with AsyncClient(service.base_url) as lab, lab.stream_com(CONFIGURATION) as stream:
        estimates, health = await asyncio.gather(stream.send(SAMPLES), lab.health())
        assert health.status == "ok"
        assert [estimate.time_s for estimate in estimates] == [sample.time_s for sample in SAMPLES]
        with pytest.raises(ProblemError) as refused:
            await stream.send(SAMPLES[:1])
        assert refused.value.code == "time-not-increasing"
        assert refused.value.errors[0].where == "samples[0].time_s"
        with pytest.raises(Unreachable, match="4422 time-not-increasing"):
            await stream.send(SAMPLES[:1])


def test_a_refused_configuration_is_a_problem(lab: Client) -> None:
    wrong = StreamConfiguration(mass_kg=70.0, rate_hz=RATE_HZ, cutoffs=(4.0, 0.4))
    with pytest.raises(ProblemError) as refused, lab.stream_com(wrong):
        pass
    assert refused.value.code == "cutoffs-out-of-range"


def test_unreachable_and_refusing_services_are_distinguished(service: Served) -> None:
    unreachable, wrong_path = Client("http://127.0.0.1:9", timeout_s=5.0), Client(f"{service.base_url}/elsewhere")
    with unreachable, pytest.raises(Unreachable, match="does not answer"), unreachable.stream_com(CONFIGURATION):
        pass
    with wrong_path, pytest.raises(ProblemError) as refused, wrong_path.stream_com(CONFIGURATION):
        pass
    assert (refused.value.code, refused.value.status) == ("stream-refused", 403)


def test_packing_is_the_documented_layout() -> None:
    some = [
        StreamSample(time_s=7.0, geometry_m=(1.0, 2.0, 3.0), force_n=(4.0, 5.0, 6.0), moment_nm=(7.0, 8.0, 9.0)),
        StreamSample(time_s=7.5, geometry_m=(1.0, 2.0, 3.0)),
    ]
    nan = float("nan")
    rows = ((0.0, *range(1, 10)), (0.5, 1, 2, 3, nan, nan, nan, nan, nan, nan))
    assert encode_samples(some, "float32") == pack_samples(7.0, *rows)
    assert encode_samples([], "float32") == pack_samples(0.0)
    (back,) = decode_estimates(pack_samples(7.0, (0.5, *range(1, 10))))
    assert (back.time_s, back.com_m, back.velocity_m_s, back.sd_m) == (7.5, (1, 2, 3), (4, 5, 6), (7, 8, 9))


@pytest.mark.parametrize("raw", [b"", b"123", "hello", "[]", '{"samples": [{}]}'])
def test_an_invalid_answer_is_an_error_of_the_client(raw: str | bytes) -> None:
    with pytest.raises(ClientError, match="cannot parse"):
        decode_estimates(raw)


@pytest.fixture
def talking() -> Iterator[Address]:
    """A service whose live robot says two things and ends."""

    def talk(connection: ServerConnection) -> None:
        assert connection.request is not None
        connection.send(connection.request.path)
        connection.send("second")

    with serve(talk, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield Address(f"http://127.0.0.1:{server.socket.getsockname()[1]}", {}, 5.0)
        server.shutdown()


def test_a_live_robot_is_watched_until_it_ends(talking: Address) -> None:
    with Client(talking.base) as lab:
        assert list(lab.watch_live("ab12")) == ["/api/v1/live/ab12", "second"]


@pytest.mark.anyio
async def test_a_live_robot_is_watched_by_the_asynchronous_client(talking: Address) -> None:
    async with AsyncClient(talking.base) as lab:
        assert [message async for message in lab.watch_live("ab12")] == ["/api/v1/live/ab12", "second"]
