"""``stridelab live``: a robot that carries out its motion in physics while people watch and push it in the browser."""

import json
import subprocess
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Final
from urllib.parse import urlsplit

import typer
from rich.markup import escape

from stridelab.cli.options import AsJson, Token
from stridelab.cli.results import err, out
from stridelab.errors import Fault, InvalidInput, NotFound, Unavailable
from stridelab.schemas.live.messages import MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S, LiveInput

SERVER: Final = "http://127.0.0.1:8000"
START_S: Final = 120.0
_LOOK_S: Final = 0.5


def live(
    scenario: Annotated[str | None, typer.Argument(help="Id of a stored scenario, such as six-stairs.")] = None,
    robot: Annotated[str | None, typer.Option("--robot", help="Instead of a scenario: a level walk of it.")] = None,
    *,
    velocity: Annotated[
        str | None,
        typer.Option("--velocity", help="AHEAD,LEFT,TURN in m/s and rad/s, e.g. 0.3,0,0.1: walk like this instead."),
    ] = None,
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
    as_json: AsJson = False,
    server: Annotated[str, typer.Option("--server", help="URL of the service.")] = SERVER,
    token: Token = None,
) -> None:
    """Let a robot carry out its motion in physics, live in the browser; starts a service here if none runs."""
    if (scenario is None) == (robot is None):
        raise InvalidInput(
            "option-invalid", "Give either a scenario or --robot.", [Fault("SCENARIO, --robot", "give one of them")]
        )
    commanded = None if velocity is None else _parse_velocity(velocity)
    from stridelab.cli.remote import translated_errors
    from stridelab.client import Client

    with _running_service(server, token) as started, translated_errors(server, lambda: NotFound):
        with Client(server, token) as client:
            session = client.start_live(scenario, robot, commanded)
        address = server.rstrip("/") + session.page
        if as_json:
            typer.echo(json.dumps({**session.model_dump(mode="json"), "url": address}))
        else:
            out.print(f"{escape(session.title)} is live: {escape(address)}")
        if browser:
            webbrowser.open(address)
        if started is not None:
            err.print("The service was started for this robot; Ctrl-C stops both.")
            started.wait()


def _parse_velocity(text: str) -> tuple[float, float, float]:
    """Ahead, left and turning. Raises ``InvalidInput`` (``option-invalid``)."""
    try:
        ahead, left, turn = (float(part) for part in text.split(","))
        LiveInput(robot="any", velocity=(ahead, left, turn))
    except ValueError as error:
        limits = f"{MAX_AHEAD_M_S:g} and {MAX_LEFT_M_S:g} m/s, {MAX_TURN_RAD_S:g} rad/s"
        fault = Fault("--velocity", f"{text} is not AHEAD,LEFT,TURN of at most {limits}")
        raise InvalidInput("option-invalid", f"{fault.message}, for example 0.3,0,0.1.", [fault]) from error
    return ahead, left, turn


@contextmanager
def _running_service(server: str, token: str | None) -> Iterator["subprocess.Popen[bytes] | None"]:
    """A service at ``server``: the one that runs there, or one that is started and stopped here.

    Raises ``Unavailable`` (``service-unreachable``, ``service-not-started``).
    """
    if _service_answers(server, token):
        yield None
        return
    address = urlsplit(server)
    if address.hostname not in ("127.0.0.1", "localhost", "::1"):
        raise Unavailable("service-unreachable", f"No service answers at {server}.")
    err.print("No service runs here; starting one.")
    port = str(address.port or 80)
    serving = subprocess.Popen([sys.executable, "-m", "stridelab.cli", "serve", "--port", port], stdout=sys.stderr)
    try:
        until_s = time.monotonic() + START_S
        while not _service_answers(server, token):
            if serving.poll() is not None or time.monotonic() > until_s:
                raise Unavailable("service-not-started", f"The service did not start at {server}; see its messages.")
            time.sleep(_LOOK_S)
        yield serving
    finally:
        serving.terminate()
        serving.wait()


def _service_answers(server: str, token: str | None) -> bool:
    from stridelab.client import Client, Unreachable

    try:
        with Client(server, token) as client:
            client.health()
    except Unreachable:
        return False
    return True
