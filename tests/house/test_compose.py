"""The compose files are consistent with each other and with the settings."""

import shlex
from pathlib import Path

import pytest
import yaml

from stridelab.service.settings import Settings

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def compose() -> dict:
    return yaml.safe_load((ROOT / "docker-compose.yml").read_text(encoding="utf-8"))


def test_services_depend_on_services_that_exist(compose: dict) -> None:
    for service in compose["services"].values():
        assert set(service.get("depends_on", {})) <= set(compose["services"])


def test_every_variable_is_a_setting(compose: dict) -> None:
    known = {f"STRIDELAB_{name.upper()}" for name in Settings.model_fields}
    for service in compose["services"].values():
        ours = {name for name in service.get("environment", {}) if name.startswith("STRIDELAB_")}
        assert ours <= known


def test_secrets_and_volumes_are_declared(compose: dict) -> None:
    for service in compose["services"].values():
        assert set(service.get("secrets", [])) <= set(compose["secrets"])
        named = {v.split(":")[0] for v in service.get("volumes", []) if not v.startswith((".", "/"))}
        assert named <= set(compose["volumes"])


def test_one_shot_migration_comes_before_everything_that_needs_tables(compose: dict) -> None:
    for name in ("api", "worker"):
        assert compose["services"][name]["depends_on"]["migrate"]["condition"] == "service_completed_successfully"


def test_commands_exist(compose: dict) -> None:
    from typer.main import get_command

    from stridelab.cli import app

    commands = get_command(app).commands  # type: ignore[attr-defined]
    for service in compose["services"].values():
        if "stridelab" not in service["image"]:
            continue
        name, *options = service["command"]
        known = {flag for parameter in commands[name].params for flag in parameter.opts}
        assert set(options) <= known, f"{name} has no {options}"


def test_image_copies_what_the_package_needs() -> None:
    lines = (ROOT / "backend" / "Dockerfile").read_text(encoding="utf-8").splitlines()
    copied = {
        word for line in lines if line.startswith("COPY") and "--from" not in line for word in shlex.split(line)[1:-1]
    }
    assert {"backend", "frontend", "models", "pyproject.toml", "requirements.lock"} <= copied
    assert all((ROOT / name).exists() for name in copied)
