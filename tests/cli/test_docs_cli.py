"""docs/cli.md and docs/settings.md say what there is: every command, option, exit code, setting and default."""

import re
from pathlib import Path

import pytest
from typer.main import get_command

from stridelab.cli.app import app
from stridelab.cli.results import EXIT_CODES, FAILURE, INTERRUPTED
from stridelab.schemas.jobs import SimulationNoise
from stridelab.schemas.methods import METHODS
from stridelab.service.settings import Settings

DOCS = Path(__file__).parents[2] / "docs"
CLI = (DOCS / "cli.md").read_text(encoding="utf-8")
SETTINGS = (DOCS / "settings.md").read_text(encoding="utf-8")
GROUPS = get_command(app).commands  # type: ignore[attr-defined]
COMMANDS = {
    (f"{name} {inner}" if inner else name): command
    for name, group in GROUPS.items()
    for inner, command in getattr(group, "commands", {"": group}).items()
}
"""Those of a group by both names."""


def section_of(command: str) -> str:
    """From the command's first mention at the start of a line to that of the next command or heading."""
    start = re.search(rf"^`stridelab {command}\b", CLI, re.MULTILINE)
    assert start, f"no paragraph of docs/cli.md begins with `stridelab {command}`"
    rest = CLI[start.end() :]
    end = re.search(r"^(`stridelab |## )", rest, re.MULTILINE)
    return rest[: end.start()] if end else rest


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_a_command_lists_exactly_its_options(name: str) -> None:
    options = {flag for p in COMMANDS[name].params for flag in p.opts if flag.startswith("--") and flag != "--help"}
    listed = set(re.findall(r"^\| `(--[a-z-]+)`", section_of(name), re.MULTILINE))
    assert listed == options


def test_no_command_is_documented_that_does_not_exist() -> None:
    starts = re.findall(r"^`stridelab ([a-z][^`\n]*)", CLI, re.MULTILINE)
    longest_first = sorted(COMMANDS, key=len, reverse=True)
    assert {next((c for c in longest_first if f"{s} ".startswith(f"{c} ")), s) for s in starts} == set(COMMANDS)


def test_the_exit_codes_are_those_of_the_program() -> None:
    listed = {int(code) for code in re.findall(r"^\| (\d+) \|", CLI, re.MULTILINE)}
    assert listed == {0, FAILURE, INTERRUPTED, *EXIT_CODES.values()}
    assert len(set(EXIT_CODES.values())) == len(EXIT_CODES)


def test_every_kind_of_noise_is_named() -> None:
    assert all(f"`{field}`" in section_of("simulate") for field in SimulationNoise.model_fields)


def test_the_settings_are_listed_with_their_defaults() -> None:
    rows = dict(re.findall(r"^\| `STRIDELAB_([A-Z_]+)` \| ([^|]+) \|", SETTINGS, re.MULTILINE))
    assert {name.lower() for name in rows} == set(Settings.model_fields)
    for name, field in Settings.model_fields.items():
        if field.default not in (None, ""):
            stated = rows[name.upper()].strip("` ")
            assert stated == (f"{field.default:g}" if isinstance(field.default, float) else str(field.default)), name


def test_every_estimator_is_named_where_one_is_chosen() -> None:
    row = next(line for line in section_of("estimate").splitlines() if line.startswith("| `--method`"))
    assert set(METHODS) <= set(re.findall(r"`([a-z-]+)`", row))
