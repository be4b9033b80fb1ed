"""The OpenAPI document, with the responses for failures added uniformly to every operation."""

from collections.abc import Mapping
from typing import Any, Final

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from stridelab.schemas.base import Problem
from stridelab.service.api.problems import MEDIA_TYPE

DESCRIPTION: Final = """\
Estimates the centre of mass from gait recordings and plans multi-contact motions of humanoid robots.

Every failure is `application/problem+json` with a stable `code`, a sentence and, if applicable, the fields of the
input that caused it. Lists are paginated: pass `next` as `cursor` until it is null. Long computations are jobs: the
response to the submission is 202 with a `Location`; poll it with `?wait=60`, or follow its `/events`.
"""

_COMMON: Final[Mapping[str, str]] = {
    "401": "The API token is missing or invalid (`login-needed`).",
    "403": "The host name or origin is not allowed (`foreign-host`, `foreign-origin`), the scope of the token is too "
    "low (`scope-missing`), or the resource belongs to another user (`not-owner`).",
    "429": "Too many requests (`too-many-requests`); `Retry-After` gives the time to wait.",
    "503": "The database or the file store does not answer.",
}
_WITH_BODY: Final[Mapping[str, str]] = {
    "400": "The body is not JSON (`not-json`) or is malformed (`malformed-request`).",
    "413": "The body exceeds the size limit (`body-too-large`).",
    "415": "The content type is not supported (`unsupported-media-type`).",
}


def failure_responses(**by_status: str) -> dict[int | str, dict[str, Any]]:
    """Build the ``responses`` argument of an endpoint from texts by status, as in ``s404="No such job."``."""
    return {int(status.removeprefix("s")): {"description": text} for status, text in by_status.items()}


def form_body(fields: Mapping[str, Any], *required: str) -> dict[str, Any]:
    """Build the ``openapi_extra`` of an endpoint that takes a multipart form with ``fields``."""
    schema = {"type": "object", "required": [*required], "additionalProperties": False, "properties": dict(fields)}
    return {"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": schema}}}}


def file_response(description: str, media_type: str) -> dict[int | str, dict[str, Any]]:
    """Build the ``responses`` argument of an endpoint that returns a file."""
    binary = {"schema": {"type": "string", "format": "binary"}}
    return {200: {"description": description, "content": {media_type: binary}}}


def install_openapi(app: FastAPI) -> None:
    """Replace ``app.openapi`` by a function that adds the responses for failures."""

    def openapi_with_failures() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = get_openapi(title=app.title, version=app.version, description=DESCRIPTION, routes=app.routes)
            _describe_failures(schema)
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = openapi_with_failures  # type: ignore[method-assign]  # as documented by FastAPI


def _describe_failures(schema: dict[str, Any]) -> None:
    components = schema.setdefault("components", {}).setdefault("schemas", {})
    own = Problem.model_json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
    components.update(own.pop("$defs", {}))
    components["Problem"] = own
    for name in ("HTTPValidationError", "ValidationError"):
        components.pop(name, None)
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for operations in schema["paths"].values():
        for operation in operations.values():
            responses = operation["responses"]
            texts = {**_COMMON, **(_WITH_BODY if "requestBody" in operation else {})}
            if "422" in responses and "requestBody" not in operation:
                responses["422"] = {"description": "A parameter is not valid (`invalid-request`)."}
            elif "422" in responses and responses["422"]["description"] == "Validation Error":
                responses["422"] = {"description": "The request is not valid (`invalid-request`)."}
            for status, text in texts.items():
                responses.setdefault(status, {"description": text})
            responses.setdefault("default", {"description": "Any other failure."})
            for status, response in responses.items():
                if status == "default" or int(status) >= 400:
                    response["content"] = content
