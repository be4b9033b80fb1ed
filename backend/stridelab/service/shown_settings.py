"""The settings in force, as people may see them: a secret, and what may hold one, is only said to be set."""

from typing import Final

from stridelab.schemas.service import ShownSetting
from stridelab.service.settings import Settings

SECRET: Final = frozenset(
    {
        "api_token",
        "api_token_file",
        "database_url",
        "database_password_file",
        "blob_url",
        "blob_credentials_file",
        "otlp_url",
    }
)
"""Tokens, passwords, the files that hold them, and addresses that may carry them."""


def shown(settings: Settings) -> tuple[ShownSetting, ...]:
    """Every setting with its value in words."""
    return tuple(
        ShownSetting(
            name=f"STRIDELAB_{name.upper()}",
            value=_words(name, getattr(settings, name)),
            meaning=field.description or "",
            changed=getattr(settings, name) != field.default,
        )
        for name, field in Settings.model_fields.items()
    )


def _words(name: str, value: object) -> str:
    if value is None or value == "":
        return "not set"
    if name in SECRET:
        return "set, not shown"
    return f"{value:g}" if isinstance(value, float) else str(value)
