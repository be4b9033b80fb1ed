"""Every code block of the book is run or checked: commands and options exist, calls fit the interface, data are valid.

Python is run by tests/client/test_book_python.py. A block that is no code says so: its language is ``text``.
"""

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from stridelab.robots.card import parse_card
from support.docs import shown_calls
from support.docs.book import PAGES, Block, blocks, commands, each_of, inline_code
from support.docs.shown_calls import check_command, check_synopsis, resolved

BLOCKS = [block for page in PAGES for block in blocks(page)]


def check_shell(block: Block) -> list[str]:
    """All commands of a script."""
    return [wrong for command in commands(block.text) for wrong in check_command(command)]


def check_json(block: Block) -> list[str]:
    """One document, or one per line; each is something that the contract knows."""
    try:
        documents = [json.dumps(json.loads(block.text))]
    except ValueError:
        documents = block.text.splitlines()
    return [f"nothing of the contract: {text}" for text in documents if not shown_calls.kinds_of(text)]


def check_toml(block: Block) -> list[str]:
    """A card of a robot is one that the loader reads."""
    table = tomllib.loads(block.text)
    if "effectors" in table:
        parse_card("example", block.text.encode())
    return []


def check_yaml(block: Block) -> list[str]:
    """It is YAML."""
    yaml.safe_load(block.text)
    return []


def paths_exist(block: Block) -> list[str]:
    """In a language that cannot be run here: every path of the interface exists."""
    templates = {re.sub(r"\{\w+\}", "X", path) for path in shown_calls.description()["paths"]}
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
def test_a_code_block_runs_and_agrees_with_the_program(block: Block) -> None:
    assert block.language in CHECKS, "no test knows this language; a drawing is `text`"
    assert CHECKS[block.language](block) == []


@each_of(PAGES)
def test_commands_in_sentences_exist(page: Path) -> None:
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


@each_of(PAGES)
def test_request_bodies_in_sentences_are_valid(page: Path) -> None:
    """`POST /x` with `{...}`: the body is one that the call takes."""
    calls = [c for c in CALL.findall(page.read_text(encoding="utf-8")) if "..." not in c[2]]
    assert [
        w
        for method, path, body in calls
        for w in shown_calls.complaints(shown_calls.Call(method, shown_calls.API + path, body))
    ] == []


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
        "curl -s $api/jobs/$job | jq .nonsense",
        "until curl -s $api/nonsense; do sleep 1; done",
        "cp models/nonsense.c3d trial.c3d",
        ".venv/bin/python scripts/nonsense.py",
        "docker compose -f nonsense.yml up",
        "curl -s $api/jobs?nonsense=1",
        "curl -s -F nonsense=1 $api/recordings",
        """curl -s --json '{"nonsense": 1}' $api/jobs/plan-motion""",
        """id=$(curl -s --json '{"scenario_id": 4}' $api/jobs/plan-motion | jq -r .id)""",
    ],
)
def test_wrong_commands_and_bodies_are_detected(line: str) -> None:
    assert [wrong for command in commands(line) for wrong in check_command(command)] != []
