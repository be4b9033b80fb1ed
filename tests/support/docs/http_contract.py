"""Calls of the interface, as pages and scripts show them, held against its own description."""

import importlib
import json
import pkgutil
import re
from dataclasses import dataclass
from functools import cache
from typing import Any
from urllib.parse import parse_qs, urlsplit

from pydantic import BaseModel, ValidationError

import stridelab.schemas
from stridelab.service.api.app import create_app
from stridelab.service.settings import Settings

API = "/api/v1"
SOME_ID = "00000000-0000-4000-8000-000000000000"


@cache
def description() -> dict[str, Any]:
    """The OpenAPI document."""
    return create_app(Settings()).openapi()


@cache
def models() -> dict[str, type[BaseModel]]:
    """All models of the contract by name."""
    modules = [
        importlib.import_module(f"stridelab.schemas.{m.name}") for m in pkgutil.iter_modules(stridelab.schemas.__path__)
    ]
    found = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    return {model.__name__: model for model in found if issubclass(model, BaseModel) and model is not BaseModel}


def operation(method: str, path: str) -> dict[str, Any] | None:
    """What the service does at a path, whose variable parts may be anything."""
    fits = [
        (template.count("{"), methods[method.lower()])
        for template, methods in description()["paths"].items()
        if method.lower() in methods and re.fullmatch(re.sub(r"\{\w+\}", "[^/]+", template), path)
    ]
    return min(fits, key=lambda fit: fit[0])[1] if fits else None


@dataclass(frozen=True)
class Call:
    """A request as somebody writes it down; ``url`` begins with the path."""

    method: str
    url: str
    body: str | None = None
    fields: tuple[str, ...] = ()

    @property
    def path(self) -> str:
        """Without the query."""
        return urlsplit(self.url).path


def complaints(call: Call) -> list[str]:
    """What is wrong with a call: its path, method, query, JSON body or form fields."""
    what, found = f"{call.method} {call.path}", operation(call.method, call.path)
    if found is None:
        return [f"there is no {what}"]
    known = {p["name"] for p in found.get("parameters", []) if p["in"] == "query"}
    wrong = [f"{what} has no query parameter {name}" for name in set(parse_qs(urlsplit(call.url).query)) - known]
    content = found.get("requestBody", {}).get("content", {})
    if call.body is not None:
        if "application/json" not in content:
            wrong.append(f"{what} reads no JSON")
        elif not call.body.startswith("@"):
            wrong += misfits(content["application/json"]["schema"]["$ref"].rpartition("/")[2], call.body)
    if call.fields:
        form = content.get("multipart/form-data", {}).get("schema", {}).get("properties", {})
        wrong += [f"{what} has no field {name}" for name in set(call.fields) - set(form)]
    return wrong


def answers(call: Call, path: list[str]) -> bool:
    """Whether the answer to a call, where all goes well, has a field of a field of it."""
    found = operation(call.method, call.path) or {}
    good = [answer for status, answer in found.get("responses", {}).items() if status.startswith("2")]
    schemas = [content["schema"] for answer in good for content in answer.get("content", {}).values()]
    return any(_has(schema, path) for schema in schemas)


def _has(schema: dict[str, Any], path: list[str]) -> bool:
    if "$ref" in schema:
        return _has(description()["components"]["schemas"][schema["$ref"].rpartition("/")[2]], path)
    if not path:
        return True
    if parts := schema.get("anyOf") or schema.get("oneOf"):
        return any(_has(part, path) for part in parts)
    if path[0] in schema.get("properties", {}):
        return _has(schema["properties"][path[0]], path[1:])
    return bool(schema.get("additionalProperties")) or schema == {}


def misfits(name: str, body: str) -> list[str]:
    """Why a JSON text is no ``name`` of the contract; variables of a shell and ``...`` stand for an identifier."""
    text = re.sub(r'"(\$\w+|\.\.\.)"', f'"{SOME_ID}"', body)
    try:
        models()[name].model_validate_json(text)
    except ValidationError as error:
        return [f"no {name}: {error}"]
    return []


def kinds_of(body: str) -> list[str]:
    """Every model of the contract that a JSON text is."""
    json.loads(body)
    return [name for name in models() if not misfits(name, body)]
