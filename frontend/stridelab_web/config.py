"""Configuration of the web app; the service derives it from its settings."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import httpx
from starlette.types import Scope

from stridelab.schemas.service import Language, ShownSetting

ANONYMOUS_KEY: Final = "-"
"""Key of the callers of a service without a token."""


@dataclass(frozen=True)
class ScenarioRight:
    """Rights of a caller on a scenario: with ``key`` to replace it; without one only to read it, for the ``refusal``.

    ``key`` is a bearer token that the HTTP interface accepts for that one request, on behalf of the caller.
    """

    key: str | None
    refusal: str = ""


ScenarioRights = Callable[[Scope, str, str | None], ScenarioRight]
"""Returns the rights of the caller of a request on a scenario, given its id and its owner."""


def read_only_right(scope: Scope, scenario_id: str, owner: str | None) -> ScenarioRight:
    """Default: scenarios are read-only."""
    return ScenarioRight(None, "This service does not say who may change its scenarios.")


UserOf = Callable[[Scope], str]
"""Returns the name of the caller of a request; empty without login."""


def anonymous_user(scope: Scope) -> str:
    """Default: there is no login."""
    return ""


@dataclass(frozen=True)
class WebConfig:
    """Where the HTTP interface is and how to reach it.

    ``transport`` replaces the network if the interface runs in the same process; ``token`` is the API token,
    if one is set; ``viewer_url`` is the loopback control address of the viewer process, or None without a viewer.
    ``settings`` are the effective settings; ``language`` is that of the pages unless a reader has chosen one, None for
    that of the browser. ``scenario_right`` returns the rights of the caller of a request on a
    scenario, ``user_of`` the name of the caller.
    """

    base_url: str
    version: str
    transport: httpx.AsyncBaseTransport | None = field(default=None, repr=False)
    token: str | None = field(default=None, repr=False)
    viewer_url: str | None = None
    settings: tuple[ShownSetting, ...] = ()
    language: Language | None = None
    scenario_right: ScenarioRights = field(default=read_only_right, repr=False)
    user_of: UserOf = field(default=anonymous_user, repr=False)
