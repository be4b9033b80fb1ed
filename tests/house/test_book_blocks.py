"""Every code block of the book is run or checked: commands and options exist, calls fit the interface, data are valid.

Python is run by tests/client/test_book_python.py. A block that is no code says so: its language is ``text``.
"""

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from typer.main import get_command

from stridelab.cli import app
from stridelab.robots.card import parse
from stridelab.service.settings import Settings
from support import contract
from support.book import PAGES, ROOT, Block, blocks, inline_code
from support.shell import Command, commands

BLOCKS = [block for page in PAGES for block in blocks(page)]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
FOREIGN = {"jq", "mkdir", "cd", "openssl", "cat", "printf", "echo", "install", "export", "docker", "git", "tee"}
"""Programs of the system: nothing of theirs is checked but the files that docker compose is given."""
CURL_VALUES = {"-X", "-H", "-F", "-o", "-d", "-u", "--json", "--request", "--header", "--form", "--output", "--data"}
USAGE_ERROR = typer.BadParameter.__mro__[1]
"""What the command line raises where it cannot read its arguments; typer gives it no public name."""
ADDRESS = re.compile(r"^(?:\$\w+|https?://(?:127\.0\.0\.1|localhost|lab)(?::\d+)?/api/v1)(?=/)")


def resolved(arguments: tuple[str, ...]) -> tuple[Any, str, list[str]]:
    """The sub-command that arguments name, its name, and what is left of them; None where there is no such command."""
    found, rest, name = get_command(app), list(arguments), "stridelab"
    while (inner := getattr(found, "commands", None)) and rest and not (rest[0].startswith("-") or rest[0].isupper()):
        name, found = f"{name} {rest[0]}", inner.get(rest.pop(0))
    return found, name, rest


def check_stridelab(command: Command) -> list[str]:
    """Sub-command, options and values, as the program itself reads them."""
    found, name, rest = resolved(command.arguments)
    if found is None:
        return [f"there is no {name}"]
    try:
        found.make_context(name, rest)
    except typer.Exit:
        return []
    except USAGE_ERROR as error:
        return [f"{name}: {error}"]
    return []


def check_synopsis(command: Command) -> list[str]:
    """Sub-command and names of options."""
    found, name, rest = resolved(command.arguments)
    if found is None:
        return [f"there is no {name}"]
    known = {flag for p in found.params for flag in (*p.opts, *p.secondary_opts)} | {"--help"}
    return [f"{name} has no {word}" for word in rest if word.startswith("--") and word not in known]


def check_curl(command: Command) -> list[str]:
    """Path, method, query, fields and body, held against the description of the interface."""
    method, body, fields, address = "GET", None, [], ""
    words = iter(command.arguments)
    for word in words:
        if word.startswith("-"):
            if word not in CURL_VALUES and not re.fullmatch(r"-[sSNOfiLk]+|--(?:silent|fail|no-buffer)", word):
                return [f"curl {word} is not known to this test"]
            value = next(words) if word in CURL_VALUES else ""
            if word in {"-X", "--request"}:
                method = value
            elif word in {"--json", "-d", "--data"}:
                body, method = value, "POST" if method == "GET" else method
            elif word in {"-F", "--form"}:
                fields.append(value.partition("=")[0])
                method = "POST"
        else:
            address = word
    if not ADDRESS.match(address):
        return [f"curl {address} is no address of the service"]
    return contract.complaints(method, contract.API + ADDRESS.sub("", address), body, tuple(fields))


def check_make(command: Command) -> list[str]:
    """The target exists."""
    targets = [word for word in command.arguments if "=" not in word]
    return [f"make {t}" for t in targets if not re.search(rf"^{re.escape(t)}:", MAKEFILE, re.MULTILINE)]


def check_script(name: str) -> list[str]:
    """The file exists, wherever below the checkout one stands."""
    return [] if (ROOT / re.sub(r"^(\.\./|\./)+", "", name)).is_file() else [f"{name} does not exist"]


def check_command(command: Command) -> list[str]:
    """What is wrong with one command of a shell."""
    wrong = [f"{name} is no setting" for name in command.assigned if not known_variable(name)]
    program = re.sub(r"^(?:\.\./)*\.venv/bin/", "", command.program)
    if program == "stridelab":
        wrong += check_stridelab(command)
    elif program == "curl":
        wrong += check_curl(command)
    elif program == "make":
        wrong += check_make(command)
    elif program == "python":
        wrong += check_script(command.arguments[0])
    elif "scripts/" in program:
        wrong += check_script(program)
    elif program == "docker":
        files = [b for a, b in zip(command.arguments, command.arguments[1:], strict=False) if a == "-f"]
        wrong += [complaint for name in files for complaint in check_script(name)]
    elif program and program not in FOREIGN:
        wrong.append(f"{program} is not known to this test")
    return wrong


def known_variable(name: str) -> bool:
    """A shell's own variable, a setting, or what a script or a compose file reads."""
    if name.islower() or name.removeprefix("STRIDELAB_").lower() in Settings.model_fields:
        return True
    readers = [*(ROOT / "scripts").glob("*"), *ROOT.glob("*compose*.yml"), ROOT / "Makefile"]
    return any(re.search(rf"\b{name}\b", path.read_text(encoding="utf-8")) for path in readers if path.is_file())


def check_shell(block: Block) -> list[str]:
    """All commands of a script."""
    return [wrong for command in commands(block.text) for wrong in check_command(command)]


def check_json(block: Block) -> list[str]:
    """One document, or one per line; each is something that the contract knows."""
    try:
        documents = [json.dumps(json.loads(block.text))]
    except ValueError:
        documents = block.text.splitlines()
    return [f"nothing of the contract: {text}" for text in documents if not contract.kinds_of(text)]


def check_toml(block: Block) -> list[str]:
    """A card of a robot is one that the loader reads."""
    table = tomllib.loads(block.text)
    if "effectors" in table:
        parse("example", block.text.encode())
    return []


def check_yaml(block: Block) -> list[str]:
    """It is YAML."""
    yaml.safe_load(block.text)
    return []


def paths_exist(block: Block) -> list[str]:
    """In a language that cannot be run here: every path of the interface exists."""
    templates = {re.sub(r"\{\w+\}", "X", path) for path in contract.description()["paths"]}
    named = re.findall(r"/api/v1(?:/[\w.-]+)*", block.text)
    return [path for path in named if not any(t == path or t.startswith(f"{path}/") for t in templates)]


def run_elsewhere(_: Block) -> list[str]:
    """By tests/client/test_book_python.py."""
    return []


def no_code(_: Block) -> list[str]:
    """A drawing, a formula, a table."""
    return []


CHECKS: dict[str, Callable[[Block], list[str]]] = {
    "": check_shell,
    "sh": check_shell,
    "json": check_json,
    "toml": check_toml,
    "yaml": check_yaml,
    "matlab": paths_exist,
    "python": run_elsewhere,
    "text": no_code,
}


@pytest.mark.parametrize("block", BLOCKS, ids=lambda b: b.place)
def test_a_block_is_true(block: Block) -> None:
    assert block.language in CHECKS, "no test knows this language; a drawing is `text`"
    assert CHECKS[block.language](block) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_inside_of_sentences_are_true(page: Path) -> None:
    """`make serve`, `scripts/native`, and commands of stridelab; of a synopsis the options."""
    wrong = []
    for code in inline_code(page):
        if re.match(r"(?:make|scripts/[\w-]+|(?:\.venv/bin/)?stridelab)(?: |$)", code):
            for command in commands(code):
                partly = not resolved(command.arguments)[2] or re.search(r"\b[A-Z]{2,}\b|\.\.\.", code)
                synopsis = command.program.endswith("stridelab") and partly
                wrong += [(code, w) for w in (check_synopsis if synopsis else check_command)(command)]
    assert wrong == []


CALL = re.compile(r"`(POST|PUT|PATCH) (/[^`\s]*)` with `(\{[^`]*\})`")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_bodies_inside_of_sentences_are_true(page: Path) -> None:
    """`POST /x` with `{...}`: the body is one that the call takes."""
    calls = [c for c in CALL.findall(page.read_text(encoding="utf-8")) if "..." not in c[2]]
    assert [w for method, path, body in calls for w in contract.complaints(method, contract.API + path, body)] == []


@pytest.mark.parametrize(
    "line",
    [
        "stridelab plan six-stairs --nonsense",
        "stridelab nonsense",
        "stridelab estimate",
        "stridelab estimate trial.c3d --height tall",
        "make nonsense",
        "scripts/nonsense",
        "nonsense",
        "STRIDELAB_NONSENSE=1 make serve",
        "curl -s $api/nonsense",
        "curl -s -X PUT $api/jobs",
        "curl -s $api/jobs?nonsense=1",
        "curl -s -F nonsense=1 $api/recordings",
        """curl -s --json '{"nonsense": 1}' $api/jobs/plan-motion""",
        """id=$(curl -s --json '{"scenario_id": 4}' $api/jobs/plan-motion | jq -r .id)""",
    ],
)
def test_what_is_not_true_is_found(line: str) -> None:
    assert [wrong for command in commands(line) for wrong in check_command(command)] != []
