"""Typed HTTP client of the service, synchronous and asynchronous."""

from stridelab.client.asynchronous import AsyncClient
from stridelab.client.errors import ClientError, ProblemError, Unreachable
from stridelab.client.synchronous import Client

__all__ = ["AsyncClient", "Client", "ClientError", "ProblemError", "Unreachable"]
