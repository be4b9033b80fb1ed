"""The calls of ``endpoints`` as methods, declared once for both clients."""

from collections.abc import Awaitable, Callable, Coroutine
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, ParamSpec, Protocol, TypeVar, cast, get_args, get_type_hints, overload, runtime_checkable

from stridelab.client import endpoints

P = ParamSpec("P")
T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class _Sync(Protocol):
    def close(self) -> None: ...


class _Async(Protocol):
    def close(self) -> Awaitable[None]: ...


@runtime_checkable
class _Method(Protocol[P, T_co]):
    """A method that returns the content of a response; the asynchronous client awaits it."""

    @overload
    def __get__(self, client: _Sync, owner: type | None = None) -> Callable[P, T_co]: ...
    @overload
    def __get__(self, client: _Async, owner: type | None = None) -> Callable[P, Coroutine[Any, Any, T_co]]: ...


def _method(request_of: Callable[P, endpoints.Call[T]]) -> _Method[P, T]:
    """Method that sends the request and returns the content of its response."""

    def send(self: Any, /, *args: P.args, **options: P.kwargs) -> Any:
        return self._send(request_of(*args, **options))

    return cast(_Method[P, T], _documented(send, request_of))


def _download_method(request_of: Callable[P, endpoints.Download]) -> _Method[P, Path]:
    """Method that saves the response as a file and returns its path."""

    def save(self: Any, /, *args: P.args, **options: P.kwargs) -> Any:
        return self._save(request_of(*args, **options))

    return cast(_Method[P, Path], _documented(save, request_of))


def _documented(method: Callable[..., Any], request_of: Callable[..., Any]) -> Callable[..., Any]:
    """``method`` with the name, documentation and parameters of ``request_of``, and the type of what it returns."""
    described = signature(request_of)
    parameters = [Parameter("self", Parameter.POSITIONAL_OR_KEYWORD), *described.parameters.values()]
    content = (*get_args(get_type_hints(request_of)["return"]), Path)[0]
    method.__name__, method.__doc__ = request_of.__name__, request_of.__doc__
    method.__signature__ = described.replace(  # type: ignore[attr-defined]
        parameters=parameters, return_annotation=content
    )
    return method


class Endpoints:
    """Methods of both clients, one per call."""

    health = _method(endpoints.health)
    recordings = _method(endpoints.recordings)
    recording = _method(endpoints.recording)
    patch_recording = _method(endpoints.patch_recording)
    delete_recording = _method(endpoints.delete_recording)
    download_file = _download_method(endpoints.download_file)
    download_tracks = _download_method(endpoints.download_tracks)
    subjects = _method(endpoints.subjects)
    subject = _method(endpoints.subject)
    add_subject = _method(endpoints.add_subject)
    patch_subject = _method(endpoints.patch_subject)
    delete_subject = _method(endpoints.delete_subject)
    scenarios = _method(endpoints.scenarios)
    scenario = _method(endpoints.scenario)
    add_scenario = _method(endpoints.add_scenario)
    put_scenario = _method(endpoints.put_scenario)
    delete_scenario = _method(endpoints.delete_scenario)
    check_scenario = _method(endpoints.check_scenario)
    compose_scenario = _method(endpoints.compose_scenario)
    cross_terrain = _method(endpoints.cross_terrain)
    scaled_scene = _method(endpoints.scaled_scene)
    solvers = _method(endpoints.solvers)
    preview_plan = _method(endpoints.preview_plan)
    robots = _method(endpoints.robots)
    robot = _method(endpoints.robot)
    robot_card = _method(endpoints.robot_card)
    delete_robot = _method(endpoints.delete_robot)
    robot_preparation = _method(endpoints.robot_preparation)
    robot_reachability = _method(endpoints.robot_reachability)
    robot_links = _download_method(endpoints.robot_links)
    submit = _method(endpoints.submit)
    jobs = _method(endpoints.jobs)
    job = _method(endpoints.job)
    cancel = _method(endpoints.cancel)
    delete_job = _method(endpoints.delete_job)
    partial_results = _method(endpoints.partial_results)
    result = _method(endpoints.result)
    download_artifact = _download_method(endpoints.download_artifact)
    download_bundle = _download_method(endpoints.download_bundle)
    read_artifact = _method(endpoints.read_artifact)
    marker_streams = _method(endpoints.marker_streams)
    live_robots = _method(endpoints.live_robots)
    live_robot = _method(endpoints.live_robot)
    start_live = _method(endpoints.start_live)
    end_live = _method(endpoints.end_live)
