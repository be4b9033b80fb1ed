"""``stridelab live``: a robot that carries out its motion in physics while people watch and push it in the browser."""

import json
import subprocess
import sys
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, BinaryIO, Final
from urllib.parse import urlsplit

import typer
from rich.markup import escape

from stridelab.cli.options import AsJson, Token
from stridelab.cli.results import err, out
from stridelab.errors import Fault, InvalidInput, NotFound, Unavailable
from stridelab.schemas.live.messages import MAX_AHEAD_M_S, MAX_LEFT_M_S, MAX_TURN_RAD_S, LiveInput
from stridelab.service.local_runs import cannot_write

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
    log: Annotated[
        Path | None,
        typer.Option("--log", help="Record the robot until it ends, or Ctrl-C: an MCAP file for Foxglove and Rerun."),
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

    with (
        _opened_log(log) as log_file,
        _running_service(server, token) as started,
        translated_errors(server, lambda: NotFound),
    ):
        with Client(server, token) as client:
            session = client.start_live(scenario, robot, commanded)
        address = server.rstrip("/") + session.page
        if as_json:
            typer.echo(json.dumps({**session.model_dump(mode="json"), "url": address}))
        else:
            out.print(f"{escape(session.title)} is live: {escape(address)}")
        if browser:
            webbrowser.open(address)
        if log_file is not None:
            with Client(server, token) as client:
                _record_session(client.watch_live(session.session_id), log_file)
        if started is not None:
            err.print("The service was started for this robot; Ctrl-C stops both.")
            started.wait()


@contextmanager
def _opened_log(path: Path | None) -> Iterator[BinaryIO | None]:
    """The log, opened before a robot is started for it; an earlier one is replaced only by frames.

    Raises ``InvalidInput`` (``output-not-writable``).
    """
    if path is None:
        yield None
        return
    try:
        file = path.open("ab")
    except OSError as error:
        raise cannot_write(path, error, "--log") from error
    with file:
        yield file


def _record_session(messages: Iterator[str], file: BinaryIO) -> None:
    """Write the frames among ``messages`` to an MCAP log until they end, or Ctrl-C; a rewind does not turn it back."""
    import numpy as np

    from stridelab.service.kinds.plan_motion.motion_log import MotionLog

    log: MotionLog | None = None
    effectors: list[str] = []
    time_s, ahead_s, frames = -1.0, 0.0, 0
    try:
        for message in map(json.loads, messages):
            if message["type"] == "state" and message["robot"] is not None and log is None:
                effectors = message["robot"]["effectors"]
                file.seek(file.truncate(0))
                log = MotionLog(file, message["robot"]["links"], effectors)
            elif message["type"] == "frame" and log is not None and message["time_s"] != time_s:
                ahead_s += max(0.0, time_s - message["time_s"])
                time_s, frames = message["time_s"], frames + 1
                places, forces_n, loaded = message["effectors_m"], message["forces_n"], set(message["contacts"])
                forces = [[*places[n], *forces_n[n]] if n in loaded else [np.nan] * 6 for n in effectors]
                log.add_poses(time_s + ahead_s, np.array(message["links"]))
                log.add_com(time_s + ahead_s, np.array(message["com_m"]))
                log.add_forces(time_s + ahead_s, np.array(forces))
    finally:  # an interrupted recording is complete, too
        if log is not None:
            log.finish()
        err.print(f"{frames} frames are in {escape(file.name)}.")


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
