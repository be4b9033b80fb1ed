"""Commands and HTTP calls that the book shows, compared with the program and the interface.

Calls of the interface, as pages and scripts show them, held against its own description.

Commands that the book shows, held against the program, the Makefile, the scripts and the interface; none is run.
"""

import importlib
import json
import pkgutil
import re
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any
from urllib.parse import parse_qs, urlsplit

import typer
from pydantic import BaseModel, ValidationError
from typer.main import get_command

import stridelab.schemas
from stridelab.cli.app import app
from stridelab.service.api.app import create_app
from stridelab.service.settings import Settings
from support.docs.book import ROOT, Command

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
        importlib.import_module(m.name)
        for m in pkgutil.walk_packages(stridelab.schemas.__path__, f"{stridelab.schemas.__name__}.")
    ]
    classes = [value for module in modules for value in vars(module).values() if isinstance(value, type)]
    return {model.__name__: model for model in classes if issubclass(model, BaseModel) and model is not BaseModel}


def operation(method: str, path: str) -> dict[str, Any] | None:
    """Description of the operation at a path, whose variable parts may have any value."""
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
    """Faults of a call: its path, method, query, JSON body or form fields."""
    what, described = f"{call.method} {call.path}", operation(call.method, call.path)
    if described is None:
        return [f"there is no {what}"]
    known = {p["name"] for p in described.get("parameters", []) if p["in"] == "query"}
    wrong = [f"{what} has no query parameter {name}" for name in set(parse_qs(urlsplit(call.url).query)) - known]
    content = described.get("requestBody", {}).get("content", {})
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
    described = operation(call.method, call.path) or {}
    good = [answer for status, answer in described.get("responses", {}).items() if status.startswith("2")]
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


MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
FOREIGN = {
    "cat", "cd", "cp", "echo", "export", "git", "install", "mkdir", "openssl", "printf", "python", "sleep", "tee",
}  # fmt: skip
"""Of other programs only the files are checked that lie in this tree."""
CURL_VALUES = {"-X", "-H", "-F", "-o", "-d", "-u", "--json", "--request", "--header", "--form", "--output", "--data"}
USAGE_ERROR: Any = typer.BadParameter.__mro__[1]
"""What the command line raises where it cannot read its arguments; typer gives it no public name."""
ADDRESS = re.compile(r"^(?:\$\w+|https?://(?:127\.0\.0\.1|localhost|lab)(?::\d+)?/api/v1)(?=/)")


@cache
def _program() -> Any:
    return get_command(app)


def resolved(arguments: tuple[str, ...]) -> tuple[Any, str, list[str]]:
    """The sub-command that arguments name, its name, and what is left of them; None where there is no such command."""
    command, rest, name = _program(), list(arguments), "stridelab"
    while (inner := getattr(command, "commands", None)) and rest and not (rest[0].startswith("-") or rest[0].isupper()):
        name, command = f"{name} {rest[0]}", inner.get(rest.pop(0))
    return command, name, rest


def check_stridelab(command: Command) -> list[str]:
    """Sub-command, options and values, as the program itself reads them."""
    option_command, name, rest = resolved(command.arguments)
    if option_command is None:
        return [f"there is no {name}"]
    try:
        option_command.make_context(name, rest)
    except typer.Exit:
        return []
    except USAGE_ERROR as error:
        return [f"{name}: {error}"]
    return []


def check_synopsis(command: Command) -> list[str]:
    """Sub-command and names of options."""
    synopsis_command, name, rest = resolved(command.arguments)
    if synopsis_command is None:
        return [f"there is no {name}"]
    known = {flag for p in synopsis_command.params for flag in (*p.opts, *p.secondary_opts)} | {"--help"}
    return [f"{name} has no {word}" for word in rest if word.startswith("--") and word not in known]


def call_of(command: Command) -> Call | str:
    """The call that a curl makes, or what is not understood of it."""
    method, body, fields, address = "GET", None, [], ""
    words = iter(command.arguments)
    for word in words:
        if not word.startswith("-"):
            address = word
        elif word in CURL_VALUES:
            value = next(words)
            if word in {"-X", "--request"}:
                method = value
            elif word in {"--json", "-d", "--data"}:
                body, method = value, "POST" if method == "GET" else method
            elif word in {"-F", "--form"}:
                fields.append(value.partition("=")[0])
                method = "POST"
        elif not re.fullmatch(r"-[sSNOfiLk]+|--(?:silent|fail|no-buffer)", word):
            return f"curl {word} is not known to this test"
    if not ADDRESS.match(address):
        return f"curl {address} is no address of the service"
    return Call(method, API + ADDRESS.sub("", address), body, tuple(fields))


def check_curl(command: Command) -> list[str]:
    """Path, method, query, fields and body, held against the description of the interface."""
    call = call_of(command)
    return [call] if isinstance(call, str) else complaints(call)


def check_jq(command: Command) -> list[str]:
    """Check that the selected field is in the answer of the call."""
    picked = [word for word in command.arguments if re.fullmatch(r"(?:\.[a-z_]\w*)+", word)]
    call = call_of(command.fed_by) if command.fed_by and command.fed_by.program == "curl" else ""
    if isinstance(call, str):
        return []
    return [f"{call.url} answers no {path}" for path in picked if not answers(call, path[1:].split("."))]


def check_make(command: Command) -> list[str]:
    """The target exists."""
    targets = [word for word in command.arguments if "=" not in word]
    return [f"make {t}" for t in targets if not re.search(rf"^{re.escape(t)}:", MAKEFILE, re.MULTILINE)]


def check_file(name: str) -> list[str]:
    """The file exists, wherever below the checkout one stands."""
    path = re.sub(r"^(\.\./|\./)+", "", name.partition("::")[0])
    return [] if (ROOT / path).exists() else [f"{name} does not exist"]


def check_docker(command: Command) -> list[str]:
    """The compose files exist."""
    return [wrong for flag, name in pairwise(command.arguments) if flag == "-f" for wrong in check_file(name)]


CHECKS = {"stridelab": check_stridelab, "curl": check_curl, "jq": check_jq, "make": check_make, "docker": check_docker}


def check_command(command: Command) -> list[str]:
    """Faults of one shell command."""
    wrong = [f"{name} is no setting" for name in command.assigned if not known_variable(name)]
    program = re.sub(r"^(?:\.\./)*\.venv/bin/", "", command.program)
    if program in CHECKS:
        wrong += CHECKS[program](command)
    elif "scripts/" in program:
        wrong += check_file(program)
    elif program and program not in FOREIGN:
        wrong.append(f"{program} is not known to this test")
    paths = [
        word for word in command.arguments if re.match(r"(?:\.\./)*(?:models|docs|deploy|scripts|tests)/[^*]*$", word)
    ]
    return wrong + [complaint for name in paths for complaint in check_file(name)]


def known_variable(name: str) -> bool:
    """A shell's own variable, a setting, or what a script or a compose file reads."""
    if name.islower() or name.removeprefix("STRIDELAB_").lower() in Settings.model_fields:
        return True
    readers = [*(ROOT / "scripts").glob("*"), *ROOT.glob("*compose*.yml"), ROOT / "Makefile"]
    return any(re.search(rf"\b{name}\b", path.read_text(encoding="utf-8")) for path in readers if path.is_file())
