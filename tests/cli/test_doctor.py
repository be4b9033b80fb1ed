"""Each check of ``doctor`` can fail, and then says what to do."""

import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from stridelab.cli.doctor import machine as doctor
from stridelab.cli.doctor.checks import Check
from stridelab.service.settings import Settings


def test_unsupported_python_versions_are_reported() -> None:
    assert [doctor.check_python_version((3, minor)).ok for minor in (10, 11, 13, 14)] == [False, True, True, False]


def test_missing_packages_are_named() -> None:
    assert doctor.check_packages(["json"]).ok
    check = doctor.check_packages(["json", "no_such_package"])
    assert not check.ok
    assert "no_such_package" in check.detail


def test_models_are_located() -> None:
    assert doctor.check_models().ok


def test_the_bundled_database_runs() -> None:
    check = doctor.check_database(Settings())
    assert check.ok
    assert "PostgreSQL" in check.detail


FAILING: dict[str, tuple[Callable[[Settings], Check], Callable[[Path], Settings], str]] = {
    "no binaries": (doctor.check_database, lambda folder: Settings(pg_bin=folder), "STRIDELAB_PG_BIN"),
    "no server": (
        doctor.check_database,
        lambda _: Settings(database_url="postgresql://nobody@127.0.0.1:9/x"),
        "STRIDELAB_DATABASE_URL",
    ),
    "no password file": (
        doctor.check_database,
        lambda folder: Settings(database_url="postgresql://x@y/z", database_password_file=folder / "none"),
        "STRIDELAB_DATABASE_PASSWORD_FILE",
    ),
    "data in a file": (
        doctor.check_data_folder,
        lambda folder: Settings(data_dir=a_file(folder) / "data"),
        "STRIDELAB_DATA_DIR",
    ),
    "no disk": (doctor.check_disk, lambda folder: Settings(data_dir=folder, min_free_disk_mb=10**12), "Free"),
    "open without token": (doctor.check_network, lambda _: Settings(host="0.0.0.0"), "STRIDELAB_API_TOKEN"),
    "no token file": (
        doctor.check_network,
        lambda folder: Settings(host="0.0.0.0", api_token_file=folder / "none"),
        "STRIDELAB_API_TOKEN_FILE",
    ),
}


def a_file(folder: Path) -> Path:
    (folder / "file").write_text("")
    return folder / "file"


@pytest.mark.parametrize("name", FAILING)
def test_a_failing_check_gives_the_remedy(name: str, tmp_path: Path) -> None:
    check, settings, fix = FAILING[name]
    results = check(settings(tmp_path))
    assert not results.ok
    assert fix in results.fix


def test_a_taken_port_is_reported_with_the_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        check = doctor.check_port(Settings(port=listener.getsockname()[1]))
    assert not check.ok
    assert "STRIDELAB_PORT" in check.fix


def test_the_same_checks_pass_where_nothing_is_wrong(tmp_path: Path) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        free = probe.getsockname()[1]
    settings = Settings(data_dir=tmp_path / "new" / "data", port=free)
    for check in (doctor.check_data_folder, doctor.check_disk, doctor.check_port, doctor.check_network):
        assert check(settings).ok, check
    assert not (tmp_path / "new").exists(), "a check leaves nothing behind"


def test_a_token_opens_the_network() -> None:
    assert doctor.check_network(Settings(host="0.0.0.0", api_token="x")).ok


def test_a_service_that_does_not_answer_fails_the_check(capsys: pytest.CaptureFixture[str]) -> None:
    assert not doctor.report_service("http://127.0.0.1:9")
    assert "FAIL" in capsys.readouterr().out


def test_invalid_settings_are_the_only_result(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("STRIDELAB_PORT", "eighty")
    assert not doctor.check_machine()
    assert "STRIDELAB_PORT" in capsys.readouterr().out
