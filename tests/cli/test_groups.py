"""A command takes a group of options as one object; typed, they are options like any others."""

from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from stridelab.cli.options import with_groups


@dataclass(frozen=True)
class Journey:
    place: Annotated[str, typer.Argument(help="Where to.")]
    days: Annotated[int, typer.Option("--days", help="How long.")] = 2


TAKEN: list[tuple[object, ...]] = []


@with_groups
def travel(
    *,
    before: Annotated[bool, typer.Option("--before", help="Before.")] = False,
    journey: Journey,
    after: Annotated[str | None, typer.Option("--after", help="After.")] = None,
) -> None:
    """Go."""
    TAKEN.append((before, journey, after))


APP = typer.Typer()
APP.command()(travel)


@pytest.fixture(autouse=True)
def clear_taken() -> None:
    TAKEN.clear()


def test_options_reach_the_command_as_one_group() -> None:
    assert CliRunner().invoke(APP, ["Padua", "--days", "5", "--after", "x"]).exit_code == 0
    assert CliRunner().invoke(APP, ["--before", "Bath"]).exit_code == 0
    assert [(False, Journey("Padua", 5), "x"), (True, Journey("Bath"), None)] == TAKEN


def test_a_field_without_default_must_be_typed() -> None:
    assert CliRunner().invoke(APP, ["--days", "5"]).exit_code == 2
    assert TAKEN == []


def test_help_has_the_fields_where_the_group_stands() -> None:
    output = CliRunner().invoke(APP, ["--help"]).output
    places = [output.index(word) for word in ("Go.", "Where to.", "Before.", "How long.", "After.")]
    assert places == sorted(places)
