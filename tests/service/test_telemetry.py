"""Traces are off by default, and nothing waits for a collector; tests/recovery/test_cluster.py sees whole ones."""

import subprocess
import sys
import time

import pytest

from stridelab.errors import InvalidInput
from stridelab.service import telemetry
from support.service.external_services import collector
from support.service.processes import environment, free_port

SPANS = 2000
"""Fewer than the 2048 spans that are buffered while the collector is slow."""
SCRIPT = """
import sys
from stridelab.service import telemetry
with telemetry.export_spans(sys.argv[1], "test"):
    for _ in range(int(sys.argv[2])):
        with telemetry.start_span("work"):
            pass
print("done")
"""


def test_without_a_collector_there_is_no_trace() -> None:
    with telemetry.export_spans(None, "test"), telemetry.start_span("request") as span:
        assert not span.is_recording()
        assert telemetry.current_traceparent() is None


def test_what_a_client_began_is_passed_on_without_a_collector_too() -> None:
    begun = "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"
    with telemetry.start_span("request", parent=begun):
        assert telemetry.current_traceparent() == begun


@pytest.mark.parametrize("odd", ["00-0-0-0", "x", "00-" + "0" * 32 + "-" + "0" * 16 + "-01", "\n"])
def test_an_odd_parent_is_no_parent(odd: str) -> None:
    with telemetry.start_span("request", parent=odd):
        assert telemetry.current_traceparent() is None


@pytest.mark.parametrize("url", ["collector:4318", "file:///x", "http://", ""])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(InvalidInput) as caught, telemetry.export_spans(url, "test"):
        pass
    assert caught.value.code == "otlp-url-invalid"


def run(url: str) -> float:
    began = time.monotonic()
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT, url, str(SPANS)], capture_output=True, text=True, env=environment()
    )
    assert process.stdout == "done\n", process.stderr
    return time.monotonic() - began


def test_every_span_arrives_before_a_program_ends() -> None:
    with collector() as heard:
        run(heard.url)
    assert len(heard.named("work")) == SPANS
    assert {service for service, _ in heard.spans} == {"stridelab-test"}


def test_a_collector_that_is_away_does_not_hold_a_program_up() -> None:
    assert run(f"http://127.0.0.1:{free_port()}") < 20.0
