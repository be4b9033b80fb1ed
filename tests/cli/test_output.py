"""A result folder appears whole or not at all, and only an earlier result is ever replaced."""

from pathlib import Path

import pytest

from stridelab.errors import Conflict, InvalidInput
from stridelab.service.local_runs import RESULT_FILE, result_folder


def fill(folder: Path, text: str) -> None:
    (folder / RESULT_FILE).write_text(text)
    (folder / "com.csv").write_text(text)


def write(target: Path, text: str, *, force: bool = False) -> None:
    with result_folder(target, force=force) as folder:
        fill(folder, text)


def write_and_fail(target: Path, error: BaseException, *, force: bool = False) -> None:
    with result_folder(target, force=force) as folder:
        fill(folder, "half")
        raise error


def test_the_output_folder_appears_only_when_complete(tmp_path: Path) -> None:
    write(tmp_path / "deep" / "out", "one")
    assert sorted(p.name for p in (tmp_path / "deep" / "out").iterdir()) == ["com.csv", RESULT_FILE]
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["out"]


@pytest.mark.parametrize("error", [ValueError("bad"), KeyboardInterrupt()])
def test_a_failure_leaves_nothing(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)):
        write_and_fail(tmp_path / "out", error)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_is_refused_without_force_and_replaced_with_it(tmp_path: Path) -> None:
    target = tmp_path / "out"
    write(target, "one")
    with pytest.raises(Conflict) as refusal:
        write(target, "two")
    assert refusal.value.code == "output-exists"
    assert (target / "com.csv").read_text() == "one"
    write(target, "two", force=True)
    assert (target / "com.csv").read_text() == "two"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_failure_under_force_keeps_the_earlier_result(tmp_path: Path) -> None:
    target = tmp_path / "out"
    write(target, "one")
    with pytest.raises(ValueError, match="late"):
        write_and_fail(target, ValueError("late"), force=True)
    assert (target / "com.csv").read_text() == "one"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("content", ["notes.txt", "sub/result.json"])
def test_force_never_replaces_a_folder_that_is_not_a_result(tmp_path: Path, content: str) -> None:
    precious = tmp_path / "home" / content
    precious.parent.mkdir(parents=True)
    precious.write_text("precious")
    with pytest.raises(Conflict) as refusal:
        write(tmp_path / "home", "two", force=True)
    assert refusal.value.code == "output-not-a-result"
    assert precious.read_text() == "precious"


def test_force_replaces_neither_a_file_nor_a_link(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("precious")
    write(tmp_path / "out", "one")
    (tmp_path / "link").symlink_to(tmp_path / "out")
    for name in ("file", "link"):
        with pytest.raises(Conflict):
            write(tmp_path / name, "two", force=True)
    assert (tmp_path / "file").read_text() == "precious"


def test_an_unwritable_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInput) as refusal:
        write(tmp_path / "file" / "out", "one")
    assert refusal.value.code == "output-not-writable"
    assert refusal.value.faults[0].where == "--out"
