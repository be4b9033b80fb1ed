"""What people may see of the settings: every one of them, and no secret in any."""

from pathlib import Path

from pydantic import SecretStr

from stridelab.service.settings import Settings, shown_settings


def test_every_setting_is_listed_with_its_description() -> None:
    items = {item.name: item for item in shown_settings(Settings(port=8123, parse_timeout_s=12.5))}
    assert set(items) == {f"STRIDELAB_{name.upper()}" for name in Settings.model_fields}
    assert all(item.meaning for item in items.values())
    assert (items["STRIDELAB_PORT"].value, items["STRIDELAB_PORT"].changed) == ("8123", True)
    assert items["STRIDELAB_PARSE_TIMEOUT_S"].value == "12.5"
    assert items["STRIDELAB_MAX_UPLOAD_MB"].changed is False


def test_no_secret_and_no_path_of_a_secret_is_shown() -> None:
    secret = "correct-horse"
    settings = Settings(
        api_token=SecretStr(secret),
        api_token_file=Path(f"/etc/{secret}"),
        database_url=f"postgresql://lab:{secret}@host/name",
        database_password_file=Path(f"/etc/{secret}"),
        blob_url=f"s3://{secret}@bucket",
    )
    items = shown_settings(settings)
    assert secret not in repr(items)
    assert sum(item.value == "set, not shown" for item in items) == 5
