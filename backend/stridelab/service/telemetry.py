"""Traces (OpenTelemetry): a request, the job that it submits and each attempt at it are one trace.

Off unless ``STRIDELAB_OTLP_URL`` names a collector; spans then cost microseconds and go nowhere. They carry routes,
kinds, ids and states, never names of files or people, nor addresses of clients.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final
from urllib.parse import urlsplit

from opentelemetry import trace
from opentelemetry.trace import Span, SpanKind, StatusCode
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

from stridelab import __version__
from stridelab.errors import InvalidInput

_HEADER: Final = "traceparent"
_TIMEOUT_S: Final = 5.0
"""A collector that is away must not hold up a program that ends."""
_propagator: Final = TraceContextTextMapPropagator()


@contextmanager
def exported(collector_url: str | None, program: str) -> Iterator[None]:
    """Send the spans of this process to a collector as ``stridelab-<program>`` while the context lasts.

    Raises ``InvalidInput`` (``otlp-url-invalid``).
    """
    if collector_url is None:
        yield
        return
    parts = urlsplit(collector_url)
    if parts.scheme not in {"http", "https"} or not parts.hostname:
        raise InvalidInput("otlp-url-invalid", "STRIDELAB_OTLP_URL must be the http(s) address of a collector.")
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import BatchSpanProcessor

    named = Resource.create({"service.name": f"stridelab-{program}", "service.version": __version__})
    provider = TracerProvider(resource=named, shutdown_on_exit=False)
    exporter = OTLPSpanExporter(endpoint=f"{collector_url.rstrip('/')}/v1/traces", timeout=_TIMEOUT_S)
    provider.add_span_processor(BatchSpanProcessor(exporter))
    trace.set_tracer_provider(provider)
    try:
        yield
    finally:
        provider.shutdown()


@contextmanager
def span(
    name: str,
    attributes: Mapping[str, str | int] | None = None,
    *,
    parent: str | None = None,
    kind: SpanKind = SpanKind.INTERNAL,
) -> Iterator[Span]:
    """A span around what happens in the context: below ``parent`` (a ``traceparent``), else below the present one."""
    above = _propagator.extract({_HEADER: parent}) if parent else None
    tracer = trace.get_tracer("stridelab", __version__)
    with tracer.start_as_current_span(name, context=above, kind=kind, attributes=attributes) as made:
        yield made


def failed(of: Span) -> None:
    """Mark a span as that of something that went wrong."""
    of.set_status(StatusCode.ERROR)


def traceparent() -> str | None:
    """The present span, as it is passed on; None outside of all traces."""
    carrier: dict[str, str] = {}
    _propagator.inject(carrier)
    return carrier.get(_HEADER)
