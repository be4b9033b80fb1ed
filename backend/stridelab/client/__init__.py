"""Typed HTTP client of the service, synchronous and asynchronous."""

from stridelab.client.asynchronous import AsyncClient
from stridelab.client.errors import ClientError, ProblemError, Unreachable
from stridelab.client.streams import AsyncComStream, AsyncMarkerStream, ComStream, MarkerStream
from stridelab.client.synchronous import Client

__all__ = [
    "AsyncClient",
    "AsyncComStream",
    "AsyncMarkerStream",
    "Client",
    "ClientError",
    "ComStream",
    "MarkerStream",
    "ProblemError",
    "Unreachable",
]
