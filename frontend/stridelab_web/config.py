"""What the web app must be told; the front door takes it from the service's settings."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import httpx
from starlette.types import Scope

from stridelab.schemas.service import ShownSetting

NO_KEY_NEEDED: Final = "-"
"""The key of whoever uses a service without a token."""


@dataclass(frozen=True)
class ScenarioRight:
    """What somebody may do with a scenario: with ``key`` replace it; without one only look, and ``refusal`` says why.

    ``key`` is a bearer token that the HTTP interface accepts for that one request, as the person for whom it was made.
    """

    key: str | None
    refusal: str = ""


ScenarioRights = Callable[[Scope, str, str | None], ScenarioRight]
"""Of the caller of a request, for a scenario's id and its owner."""


def only_look(scope: Scope, scenario_id: str, owner: str | None) -> ScenarioRight:
    """Nobody may change anything."""
    return ScenarioRight(None, "This service does not say who may change its scenarios.")


UserOf = Callable[[Scope], str]
"""The name of the caller of a request; empty where nobody logs in."""


def nobody(scope: Scope) -> str:
    """Nobody logs in."""
    return ""


@dataclass(frozen=True)
class WebConfig:
    """Where the HTTP interface is and how to reach it.

    ``transport`` short-cuts the network where the interface lives in the same process; ``token`` is the API token,
    if one is set; ``viewer_url`` is the loopback control address of the viewer process, or None where there is none.
    ``settings`` are those in force, for whoever asks. ``scenario_right`` tells what the caller of a request may do with
    a scenario, ``user_of`` who the caller is.
    """

    base_url: str
    version: str
    transport: httpx.AsyncBaseTransport | None = field(default=None, repr=False)
    token: str | None = field(default=None, repr=False)
    viewer_url: str | None = None
    settings: tuple[ShownSetting, ...] = ()
    scenario_right: ScenarioRights = field(default=only_look, repr=False)
    user_of: UserOf = field(default=nobody, repr=False)
