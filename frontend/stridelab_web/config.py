"""What the web app must be told; the front door takes it from the service's settings."""

from dataclasses import dataclass, field

import httpx

from stridelab.schemas.service import ShownSetting


@dataclass(frozen=True)
class WebConfig:
    """Where the HTTP interface is and how to reach it.

    ``transport`` short-cuts the network where the interface lives in the same process; ``token`` is the API token,
    if one is set; ``viewer_url`` is the loopback control address of the viewer process, or None where there is none.
    ``settings`` are those in force, for whoever asks.
    """

    base_url: str
    version: str
    transport: httpx.AsyncBaseTransport | None = field(default=None, repr=False)
    token: str | None = field(default=None, repr=False)
    viewer_url: str | None = None
    settings: tuple[ShownSetting, ...] = ()
