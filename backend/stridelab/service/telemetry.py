"""OpenTelemetry traces: a request, the job that it submits and each attempt of the job form one trace.

Export is off unless ``STRIDELAB_OTLP_URL`` names a collector; unexported spans cost microseconds. Spans carry routes,
kinds, ids and states, never names of files or subjects, nor addresses of clients.
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
"""Export timeout, so that an unreachable collector does not delay the exit of a program."""
_propagator: Final = TraceContextTextMapPropagator()


@contextmanager
def export_spans(collector_url: str | None, program: str) -> Iterator[None]:
    """Send the spans of this process to a collector as ``stridelab-<program>`` inside the block.

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
def start_span(
    name: str,
    attributes: Mapping[str, str | int] | None = None,
    *,
    parent: str | None = None,
    kind: SpanKind = SpanKind.INTERNAL,
) -> Iterator[Span]:
    """Start a span for the block, as child of ``parent`` (a ``traceparent``), else of the current span."""
    parent_context = _propagator.extract({_HEADER: parent}) if parent else None
    tracer = trace.get_tracer("stridelab", __version__)
    with tracer.start_as_current_span(name, context=parent_context, kind=kind, attributes=attributes) as current:
        yield current


def mark_failed(failed_span: Span) -> None:
    """Set the status of a span to error."""
    failed_span.set_status(StatusCode.ERROR)


def current_traceparent() -> str | None:
    """``traceparent`` header of the current span; None outside a trace."""
    carrier: dict[str, str] = {}
    _propagator.inject(carrier)
    return carrier.get(_HEADER)
