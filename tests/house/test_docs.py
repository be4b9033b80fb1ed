"""What a user can call, set or type is documented, and nothing is documented that does not exist."""

import re
from pathlib import Path

from typer.main import get_command

from stridelab.cli.app import app as command_line
from stridelab.service.api.app import create_app
from stridelab.service.kinds.registry import KINDS
from stridelab.service.settings import Settings

DOCS = Path(__file__).parents[2] / "docs"


def test_every_endpoint_is_documented() -> None:
    """On the page; a kind of job by its own sentences, from which the page of all endpoints is made."""
    page = (DOCS / "http-api.md").read_text(encoding="utf-8")
    described = create_app(Settings()).openapi()["paths"]
    calls = {
        f"{method.upper()} {path.removeprefix('/api/v1')}"
        for path, methods in described.items()
        for method in methods
        if path.startswith("/api/v1")
    }
    documented = set(re.findall(r"`((?:GET|POST|PUT|PATCH|DELETE) /[^`\s?]*)", page))
    of_kinds = {f"POST /jobs/{kind.name}" for kind in KINDS.values() if kind.offered}
    assert calls - documented - of_kinds == set()
    for kind in KINDS.values():
        text = described[f"/api/v1/jobs/{kind.name}"]["post"]["description"] if kind.offered else ""
        assert text.startswith(f"{kind.title}. {kind.description} ") == kind.offered
    assert documented - calls - {"GET /metrics"} == set()


def test_every_setting_is_documented() -> None:
    page = (DOCS / "settings.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"`(STRIDELAB_[A-Z_]+)`", page))
    assert {f"STRIDELAB_{name.upper()}" for name in Settings.model_fields} == documented


def test_every_command_and_option_is_documented() -> None:
    page = (DOCS / "cli.md").read_text(encoding="utf-8")
    commands = dict(get_command(command_line).commands)  # type: ignore[attr-defined]
    for group, command in list(commands.items()):
        commands |= {f"{group} {name}": inner for name, inner in getattr(command, "commands", {}).items()}
    for name, command in commands.items():
        assert f"stridelab {name}" in page
        for parameter in command.params:
            for flag in parameter.opts:
                if flag.startswith("--") and flag != "--help":
                    assert f"`{flag}" in page, f"{name} {flag}"
