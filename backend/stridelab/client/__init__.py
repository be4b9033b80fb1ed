"""Typed HTTP client of the service, synchronous and asynchronous."""

from stridelab.client.asynchronous import AsyncClient
from stridelab.client.errors import ClientError, ProblemError, Unreachable
from stridelab.client.streams import AsyncComStream, ComStream
from stridelab.client.synchronous import Client

__all__ = ["AsyncClient", "AsyncComStream", "Client", "ClientError", "ComStream", "ProblemError", "Unreachable"]
