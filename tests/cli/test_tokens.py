"""``stridelab token``: made, listed, revoked on the service's database."""

import json

import pytest
from typer.testing import CliRunner

from stridelab.cli.app import app
from stridelab.service.settings import Settings


def test_a_token_is_created_listed_and_revoked(database_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stridelab.service.settings.current_settings", lambda: Settings(database_url=database_url))

    def typed(*arguments: str) -> tuple[int, str]:
        ran = CliRunner().invoke(app, ["token", *arguments])
        return ran.exit_code, ran.stdout

    code, secret = typed("create", "p07", "--scope", "read", "--days", "30")
    assert code == 0
    assert secret.startswith("stridelab_")
    listed = typed("list")[1]
    assert "p07  read  until 20" in listed
    assert secret.strip() not in listed
    assert typed("create", "p07")[0] != 0
    assert typed("create", "p 08")[0] != 0
    assert typed("revoke", "p07")[0] == 0
    assert typed("revoke", "p07")[0] != 0
    assert typed("list")[1] == ""
    (token,) = json.loads(typed("list", "--json")[1])
    assert token["revoked_at"] is not None
    assert "hash" not in str(token)
