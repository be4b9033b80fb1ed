"""``stridelab reproduce --all`` on two quick items: one report, each item computed once, an exit code for failures."""

import json
import sys
from pathlib import Path

import pytest

from stridelab.cli import app
from stridelab.cli.reproduce import CACHE_FOLDER, REPORT, reproduce_all
from stridelab.errors import InvalidInput
from stridelab.machine import parallel
from stridelab.reproduction.chapter2 import fig_2_5

QUICK = ("fig-2.5", "fig-4.3")


def everything(out_dir: Path, *, anew: bool = False, as_json: bool = False) -> bool:
    return reproduce_all(
        QUICK, seeds=None, seed=None, quick=True, recordings=None, out_dir=out_dir, recompute=anew, as_json=as_json
    )  # fmt: skip


def test_all_items_are_in_one_report_and_computed_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out_dir = tmp_path / "new" / "folder"
    assert everything(out_dir)
    output = capsys.readouterr().out
    assert "claims of 2 items" in output
    assert str(out_dir / REPORT) in output.replace("\n", "")
    text = (out_dir / REPORT).read_text(encoding="utf-8")
    assert all(f'<section id="{name}">' in text for name in QUICK)
    assert text.count("<svg") == 2
    assert text.count("Draws nothing at random.") == 1
    assert text.count("One random sample, seed 0.") == 1
    assert {path.name.partition("-1-")[0] for path in (out_dir / CACHE_FOLDER).iterdir()} == set(QUICK)

    def broken(*_: object) -> None:
        raise RuntimeError("the filters are gone")

    monkeypatch.setattr(fig_2_5, "bode_responses", broken)
    # Processes that compute items are forked from this one, whatever threads other tests left, and see the change.
    monkeypatch.setattr(parallel, "_has_one_thread", lambda: True)
    assert everything(out_dir), "cached results need no filters"
    capsys.readouterr()
    assert not everything(out_dir, anew=True, as_json=True)
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert report["items"]["fig-2.5"] == "failed"
    assert report["items"]["fig-4.3"] != "failed"
    assert report["claims"]["met"] > 0
    assert "RuntimeError: the filters are gone" in captured.err
    assert "Not computed: RuntimeError: the filters are gone" in (out_dir / REPORT).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        ([], "ITEM"),
        (["fig-2.5", "--all"], "ITEM"),
        (["--all", "--server", "http://127.0.0.1:1"], "--server"),
        (["fig-2.5", "--quick"], "--quick"),
        (["fig-2.5", "--recordings", "."], "--recordings"),
        (["fig-3.6-people"], "--recordings"),
        (["fig-3.6-people", "--recordings", ".", "--seed", "3"], "--seed"),
        (["height-people", "--recordings", ".", "--seeds", "3"], "--seeds"),
        (["height-people", "--recordings", "nowhere"], "--recordings"),
        (["fig-3.6", "--seeds", "1"], "--seeds"),
        (["fig-3.6-people", "--recordings", ".", "--server", "http://127.0.0.1:1"], "--server"),
        (["--all", "--quick", "--seeds", "5"], "--quick"),
        (["--all", "--seeds", "201"], "--seeds"),
        (["fig-3.6", "--seeds", "201"], "--seeds"),
        (["fig-4.2", "--seeds", "3"], "--seeds"),
        (["fig-2.5", "--seed", "3"], "--seed"),
    ],
)
def test_invalid_arguments_are_refused_before_anything_is_computed(
    arguments: list[str],
    where: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(app.signal, "signal", lambda *_: None)  # type: ignore[attr-defined]
    monkeypatch.setattr(sys, "argv", ["stridelab", "reproduce", *arguments])
    with pytest.raises(SystemExit) as end:
        app.main()
    assert end.value.code == 2
    assert f"{where}:" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_an_unwritable_folder_is_reported_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InvalidInput) as refused:
        everything(tmp_path / "file")
    assert refused.value.code == "output-not-writable"


def test_the_exit_code_says_that_an_item_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(app.signal, "signal", lambda *_: None)  # type: ignore[attr-defined]
    monkeypatch.setattr("stridelab.cli.reproduce.reproduce_all", lambda *_, **__: False)
    monkeypatch.setattr(sys, "argv", ["stridelab", "reproduce", "--all", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as end:
        app.main()
    assert end.value.code == 1
