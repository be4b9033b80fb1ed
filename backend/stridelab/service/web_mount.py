"""Mounts the web app beside the HTTP API. The only module of the backend that imports the web app."""

import time

import httpx
from fastapi import FastAPI
from starlette.routing import Match, Mount
from starlette.types import Scope

from stridelab import __version__
from stridelab.errors import Forbidden
from stridelab.service.api.dependencies import CALLER_KEY
from stridelab.service.api.middleware.authentication import as_internal_app
from stridelab.service.api.session_cookies import SigningKeys
from stridelab.service.auth.callers import UNAUTHENTICATED, Caller, require_owner, require_scope
from stridelab.service.settings import Settings, shown_settings
from stridelab_web.app import create_web
from stridelab_web.config import ANONYMOUS_KEY, ScenarioRight, ScenarioRights, WebConfig

API_PREFIX = "/api/"


class _Pages(Mount):
    """Matches all paths outside ``/api/``; errors below ``/api/`` stay JSON problems of the API."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        if str(scope.get("path", "")).startswith(API_PREFIX):
            return Match.NONE, {}
        return super().matches(scope)


def mount_web_app(app: FastAPI, settings: Settings) -> None:
    """Serve the web pages beside the API of ``app``.

    The pages call the API inside this process and skip authentication: their own request has already passed it.
    """
    config = WebConfig(
        base_url=f"http://127.0.0.1:{settings.port}",
        version=__version__,
        transport=httpx.ASGITransport(app=as_internal_app(app)),
        token=settings.token,
        viewer_url=settings.viewer_url,
        settings=shown_settings(settings),
        language=settings.language,
        scenario_right=_scenario_right(app),
        user_of=_user_of,
    )
    app.router.routes.append(_Pages("", app=create_web(config)))


def _user_of(scope: Scope) -> str:
    """Name of the caller; empty where the service runs without logins."""
    caller: Caller = scope.get(CALLER_KEY, UNAUTHENTICATED)
    return caller.name or ""


def _scenario_right(app: FastAPI) -> ScenarioRights:
    """A function that decides whether the caller of a request may change a scenario."""

    def scenario_right_of(scope: Scope, scenario_id: str, owner: str | None) -> ScenarioRight:
        keys: SigningKeys | None = app.state.keys
        caller: Caller = scope.get(CALLER_KEY, UNAUTHENTICATED)
        try:
            require_scope(caller, "submit")
            require_owner(caller, owner, "scenario")
        except Forbidden as refusal:
            return ScenarioRight(None, refusal.message)
        if keys is None or caller.token_id is None:
            return ScenarioRight(ANONYMOUS_KEY)
        return ScenarioRight(keys.make_scenario_key(time.time(), caller.token_id, scenario_id))

    return scenario_right_of
