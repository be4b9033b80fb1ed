"""The online estimation over a real websocket: what is answered, what is refused, and what is left behind."""

import json
import struct
import time
from collections.abc import Iterator
from socket import SHUT_RDWR
from typing import Any

import numpy as np
import psutil
import pytest
from websockets.exceptions import InvalidStatus

from stridelab.errors import Busy
from stridelab.schemas.streams import StreamSample
from stridelab.service.api.stream.limits import BURST_S, SampleRateLimiter
from stridelab.service.processes.child import PROCESS_NAME
from support.service.database import TestDatabases
from support.service.processes import wait_until
from support.service.streams import (
    CONFIGURATION,
    MOTION,
    RATE_HZ,
    pack_samples,
    receive_close,
    receive_message,
    send_configuration,
    socket_of,
    walk_samples,
)
from support.service.web_server import Served, served

TOKEN = "a-secret-of-the-lab"
SAMPLE = {"time_s": 0.0, "geometry_m": [0, 0, 1], "force_n": [0, 0, 686.7], "moment_nm": [0, 0, 0]}
BEFORE = {**SAMPLE, "time_s": -1.0}
ROW = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 686.7, 0.0, 0.0, 0.0)
NAN = float("nan")


@pytest.fixture(scope="module")
def tight(postgres: TestDatabases, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service with little room and a token."""
    limits = {"stream_limit": 1, "stream_rate_hz": 250.0, "stream_message_kb": 20, "stream_idle_s": 1.5}
    with postgres.fresh() as url, served(url, tmp_path_factory.mktemp("data"), api_token=TOKEN, **limits) as running:
        yield running


def children() -> list[psutil.Process]:
    """The children of all fork servers of this process; these tests upload and preview nothing."""

    def is_child(process: psutil.Process) -> bool:
        try:
            return process.name() == PROCESS_NAME and process.status() != psutil.STATUS_ZOMBIE
        except psutil.Error:
            return False

    return [process for process in psutil.Process().children(recursive=True) if is_child(process)]


def test_json_and_packed_streams_agree_with_each_other_and_with_the_truth(service: Served) -> None:
    samples = walk_samples(1.0)
    rows = [(s.time_s - 0.5, *s.geometry_m, *s.force_n, *s.moment_nm) for s in samples]  # type: ignore[misc]
    with socket_of(service) as socket:
        ready = send_configuration(socket)["ready"]
        assert ready["method"] == "complementary"
        assert (ready["low_hz"], ready["high_hz"], ready["format"]) == (0.2, 1.0, "json")
        socket.send(json.dumps({"samples": [s.model_dump() for s in samples]}))
        replies = receive_message(socket)["samples"]
    with socket_of(service) as socket:
        assert send_configuration(socket, format="float32")["ready"]["format"] == "float32"
        raw = b""
        for block in (rows[:50], rows[50:]):
            socket.send(pack_samples(0.5, *block))
            answer = socket.recv(timeout=60)
            assert isinstance(answer, bytes)
            assert answer[:8] == struct.pack("<d", 0.5)
            raw += answer[8:]
    estimates = np.frombuffer(raw, "<f4").reshape(-1, 10)
    t = np.array([s.time_s for s in samples])
    assert estimates[:, 0] + 0.5 == pytest.approx(t, abs=1e-6)
    for name, columns in (("com_m", slice(1, 4)), ("velocity_m_s", slice(4, 7)), ("sd_m", slice(7, 10))):
        assert np.array([s[name] for s in replies]) == pytest.approx(estimates[:, columns], abs=2e-5), name
    assert np.abs(estimates[:, 1:4] - MOTION.com.at(t)).max() < 0.01
    assert [s["time_s"] for s in replies] == t.tolist()


def test_the_smoother_answers_a_stream(service: Served) -> None:
    samples = walk_samples(1.0)
    with socket_of(service) as socket:
        ready = send_configuration(socket, method="smoother", ahead=[1, 0])["ready"]
        assert ready["method"] == "smoother"
        assert "low_hz" not in ready
        socket.send(json.dumps({"samples": [s.model_dump() for s in samples]}))
        replies = receive_message(socket)["samples"]
        socket.send(json.dumps({"samples": [SAMPLE]}))
        assert receive_message(socket)["problem"]["code"] == "time-not-increasing"
        assert receive_close(socket) == (4422, "time-not-increasing")
    true_m = MOTION.com.at(np.array([s.time_s for s in samples]))
    assert np.abs(np.array([s["com_m"] for s in replies]) - true_m).max() < 0.01
    wait_until(lambda: not children(), 10, "its process ends")


def test_what_is_missing_is_null_or_nan(service: Served) -> None:
    nothing = (NAN, NAN, NAN)
    with socket_of(service) as socket:
        send_configuration(socket)
        socket.send(json.dumps({"samples": [SAMPLE, {"time_s": 0.005}, {"time_s": 0.01, "geometry_m": [0, 0, 1]}]}))
        replies = receive_message(socket)["samples"]
    with socket_of(service) as socket:
        send_configuration(socket, format="float32")
        socket.send(
            pack_samples(0.0, ROW, (0.005, *nothing, *nothing, *nothing), (0.01, 0.0, 0.0, 1.0, *nothing, *nothing))
        )
        answer = socket.recv(timeout=60)
    assert isinstance(answer, bytes)
    rows = np.frombuffer(answer[8:], "<f4").reshape(-1, 10)
    assert [s["com_m"] for s in replies] == [[0, 0, 1]] * 3
    assert [s["sd_m"] for s in replies] == pytest.approx(rows[:, 7:10].astype(float), abs=1e-6)


@pytest.mark.parametrize(
    ("first", "code", "status"),
    [
        ('{"mass_kg": 0, "rate_hz": 200}', "invalid-request", 422),
        ('{"mass_kg": -70, "rate_hz": 200}', "invalid-request", 422),
        ('{"mass_kg": "70", "rate_hz": 200}', "invalid-request", 422),
        ('{"mass_kg": 70}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "method": "magic"}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "colour": 1}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "priors": {"marker_m": 0}}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "priors": {"clock_s": -1}}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "method": "smoother", "priors": {"moment_nm": 0}}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "method": "smoother", "ahead": [0, 0]}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "method": "smoother", "ahead": [1e9, 0]}', "invalid-request", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "method": "smoother", "cutoffs": [0.2, 1]}', "cutoffs-not-used", 422),
        ('{"mass_kg": 70, "rate_hz": 200, "cutoffs": [4, 0.4]}', "cutoffs-out-of-range", 422),
        ('{"mass_kg": 70, "rate_hz": 5, "cutoffs": "thesis"}', "cutoffs-out-of-range", 422),
        ('{"mass_kg": 70, "rate_hz": 1e9}', "rate-too-high", 422),
        ('{"mass_kg": NaN, "rate_hz": 200}', "not-json", 400),
        ("[]", "invalid-request", 422),
        ("hello", "not-json", 400),
        ("{" * 5000, "not-json", 400),
        (" " * 20_000, "message-too-large", 413),
        (b"\x00\x01", "configuration-first", 422),
    ],
)
def test_a_configuration_that_makes_no_sense_is_refused(
    service: Served, first: str | bytes, code: str, status: int
) -> None:
    with socket_of(service) as socket:
        socket.send(first)
        problem = receive_message(socket)["problem"]
        assert (problem["code"], problem["status"]) == (code, status)
        assert len(problem["detail"]) > 20
        assert receive_close(socket) == (4000 + status, code)


def test_the_field_that_is_wrong_is_named(service: Served) -> None:
    with socket_of(service) as socket:
        problem = send_configuration(socket, mass_kg=0, priors={"step_hz": 0})["problem"]
    assert {fault["where"] for fault in problem["errors"]} == {"mass_kg", "priors.step_hz"}


@pytest.mark.parametrize(
    ("form", "content", "code", "where"),
    [
        ("json", json.dumps({"samples": [SAMPLE, SAMPLE]}), "time-not-increasing", "samples[1].time_s"),
        ("json", json.dumps({"samples": [SAMPLE, BEFORE]}), "time-not-increasing", "samples[1].time_s"),
        ("float32", pack_samples(0.0, ROW, (-1.0, *ROW[1:])), "time-not-increasing", "samples[1].time_s"),
        ("float32", pack_samples(0.0, (*ROW[:4], float("nan"), *ROW[5:])), "not-finite", "samples[0]"),
        ("json", b"\x00\xff" * 50, "wrong-format", None),
        ("float32", b"\x00\xff" * 50, "wrong-packing", None),
        ("json", "garbage", "invalid-samples", "message"),
        ("json", pack_samples(0.0, ROW), "wrong-format", None),
        ("float32", pack_samples(0.0, ROW)[:-1], "wrong-packing", None),
        ("float32", json.dumps({"samples": [SAMPLE]}), "wrong-format", None),
    ],
    ids=[
        "time stops",
        "time jumps back",
        "packed time jumps back",
        "nan",
        "bytes",
        "packed bytes",
        "garbage",
        "packed in json",
        "short",
        "json in packed",
    ],
)
def test_a_bad_sample_is_reported_and_ends_the_stream(
    service: Served, form: str, content: str | bytes, code: str, where: str | None
) -> None:
    with socket_of(service) as socket:
        send_configuration(socket, format=form)
        socket.send(content)
        problem = receive_message(socket)["problem"]
        assert (problem["code"], problem["status"]) == (code, 422)
        assert [fault["where"] for fault in problem["errors"]] == ([] if where is None else [where])
        assert receive_close(socket) == (4422, code)
    wait_until(lambda: not children(), 10, "its process ends")


def test_every_stream_has_a_process_that_ends_with_it(service: Served) -> None:
    with socket_of(service) as socket:
        send_configuration(socket)
        with socket_of(service) as other:
            send_configuration(other)
            assert len(children()) == 2
        wait_until(lambda: len(children()) == 1, 10, "the process of the closed stream ends")
        socket.socket.shutdown(SHUT_RDWR)  # as when a cable is pulled
    wait_until(lambda: not children(), 10, "the process of the lost stream ends")
    wait_until(lambda: service.parts.streams.n_open == 0, 10, "its place is free")


def test_a_killed_estimator_is_reported(service: Served) -> None:
    with socket_of(service) as socket:
        send_configuration(socket)
        (child,) = children()
        child.kill()
        socket.send(json.dumps({"samples": [SAMPLE]}))
        assert receive_message(socket)["problem"]["code"] == "stream-failed"
        assert receive_close(socket) == (4500, "stream-failed")


def test_the_rest_of_the_interface_answers_while_a_stream_computes(service: Served) -> None:
    samples = json.dumps({"samples": [s.model_dump() for s in walk_samples(4.0)]})
    with socket_of(service) as socket, service.http() as http:
        send_configuration(socket)
        socket.send(samples)
        assert http.get("/api/v1/health").status_code == 200
        assert len(receive_message(socket)["samples"]) == 800


def test_limits_close_with_a_reason(tight: Served) -> None:
    login = {"Authorization": f"Bearer {TOKEN}"}
    rows = [(i / 1000, *ROW[1:]) for i in range(400)]
    with socket_of(tight, **login) as socket:
        send_configuration(socket, format="float32")
        with socket_of(tight, **login) as second:
            assert receive_message(second)["problem"]["code"] == "too-many-streams"
            assert receive_close(second) == (4429, "too-many-streams")
        socket.send(pack_samples(0.0, *rows))
        assert isinstance(socket.recv(timeout=60), bytes)
        socket.send(pack_samples(0.4, *rows))
        assert receive_message(socket)["problem"]["code"] == "stream-too-fast"
        assert receive_close(socket) == (4429, "stream-too-fast")
    wait_until(lambda: tight.parts.streams.n_open == 0, 10, "the place is free again")
    with socket_of(tight, **login) as socket:
        send_configuration(socket, format="float32")
        socket.send(pack_samples(0.0, *rows, *rows))
        assert receive_message(socket)["problem"]["code"] == "message-too-large"
        assert receive_close(socket) == (4413, "message-too-large")
    wait_until(lambda: tight.parts.streams.n_open == 0, 10, "the place is free again")
    with socket_of(tight, **login) as socket:
        send_configuration(socket)
        assert receive_message(socket)["problem"]["code"] == "stream-idle"
        assert receive_close(socket) == (4408, "stream-idle")


def test_unauthorised_callers_get_no_stream(tight: Served, service: Served) -> None:
    foreign = {"Origin": "http://evil.example"}
    for running, headers in ((tight, {}), (tight, {"Authorization": "Bearer wrong"}), (service, foreign)):
        with pytest.raises(InvalidStatus) as refused, socket_of(running, **headers):
            pass
        assert refused.value.response.status_code == 403
    assert not children()


def test_a_stopping_service_closes_streams_with_its_code(postgres: TestDatabases, tmp_path: Any) -> None:
    with postgres.fresh() as url, served(url, tmp_path) as running, socket_of(running) as socket:
        send_configuration(socket)
        running.loop.call_soon_threadsafe(running.parts.closing.set)
        assert receive_close(socket) == (1001, "service-stops")
        wait_until(lambda: not children(), 10, "its process ends")


def test_a_sample_rate_limit_allows_a_burst_and_then_its_rate() -> None:
    now = [0.0]
    rate = SampleRateLimiter(100.0, lambda: now[0])
    rate.count_samples(int(100 * BURST_S))
    now[0] = 0.5
    rate.count_samples(50)
    with pytest.raises(Busy) as refused:
        rate.count_samples(1)
    assert refused.value.code == "stream-too-fast"


@pytest.mark.parametrize("form", ["json", "float32"])
def test_latency_is_reported(service: Served, form: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Measured, not asserted: from sending a sample to holding its estimate, sample by sample and in blocks of 10."""
    from stridelab.client import Client

    latencies = []
    with Client(service.base_url) as lab:
        began = time.perf_counter()
        with lab.stream_com(CONFIGURATION.model_copy(update={"format": form})) as stream:
            opened_s = time.perf_counter() - began
            samples = walk_samples(4.0)
            for size, chosen in ((1, samples[:400]), (10, samples[400:])):
                took = []
                for first in range(0, len(chosen), size):
                    block: list[StreamSample] = chosen[first : first + size]
                    at = time.perf_counter()
                    assert len(stream.send(block)) == size
                    took.append(1e3 * (time.perf_counter() - at))
                latencies.append(
                    f"blocks of {size}: median {np.median(took):.2f} ms, 95 % {np.percentile(took, 95):.2f} ms"
                )
    with capsys.disabled():
        print(f"\n{form} stream at {RATE_HZ:g} Hz: opened in {opened_s:.2f} s, {'; '.join(latencies)}")
