"""The list of public recordings that the survey expects, and what the survey makes of it."""

import dataclasses
import importlib.util
import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SPEC = importlib.util.spec_from_file_location("strangers_list", ROOT / "scripts" / "strangers_list.py")
assert SPEC is not None
assert SPEC.loader is not None
strangers_list = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(strangers_list)

ENTRIES = strangers_list.read_list()


def test_the_list_is_small_and_long_enough() -> None:
    assert strangers_list.LIST.stat().st_size < 1_000_000
    assert len(ENTRIES) >= 600
    assert len({entry.repository for entry in ENTRIES}) >= 15
    assert max(Counter(entry.key for entry in ENTRIES).values()) == 1


def test_every_entry_names_a_file_of_a_public_repository() -> None:
    for entry in ENTRIES:
        assert re.fullmatch(r"[\w.-]+/[\w.-]+", entry.repository)
        assert re.fullmatch(r"[0-9a-f]{40}", entry.commit)
        assert entry.outcome
        for name in filter(None, (entry.path, *entry.others, entry.static)):
            assert not Path(name).is_absolute()
            assert ".." not in Path(name).parts


def test_a_survey_that_finds_the_listed_outcomes_differs_in_nothing() -> None:
    few = ENTRIES[:3]
    rows = [{"source": entry.repository, "path": entry.key[1], "outcome": "no-markers"} for entry in few]
    expected = [dataclasses.replace(entry, outcome="no-markers") for entry in few]
    assert strangers_list.differences(expected, rows) == []
    assert strangers_list.renewed(few, rows) == expected
    other = [{**rows[0], "outcome": "estimate", "verdict": "good", "method": "smoother"}, *rows[1:2]]
    first, second = strangers_list.differences(expected, other)
    assert first.endswith(f"{few[0].path}: fused, expected no-markers")
    assert second.endswith(f"{few[2].path}: not surveyed, expected no-markers")


def weighed_trial(path: str, mass_kg: float, equipment: str = "a") -> dict[str, object]:
    return {"source": "lab/data", "path": path, "weighed_kg": [mass_kg, 0.3], "equipment": equipment}


def test_trials_of_one_person_in_one_folder_are_a_session() -> None:
    walks = [weighed_trial("x/walk1.c3d", 60.0), weighed_trial("x/walk2.c3d", 61.0), weighed_trial("x/jump.c3d", 66.0)]
    child = [weighed_trial("x/child1.c3d", 31.0), weighed_trial("x/child2.c3d", 30.0)]
    alone = [weighed_trial("y/walk3.c3d", 60.5), weighed_trial("x/walk4.c3d", 60.5, "b"), {"source": "a", "path": "b"}]
    copy = weighed_trial("x/walk1.trc", 60.0)
    sessions = strangers_list.sessions_of([*walks, copy, *alone, *child])
    assert sessions == [child[::-1], walks]


def repository_of_two_commits(folder: Path) -> list[str]:
    """A Git repository with walk.trc in two versions, which serves any commit and only the requested files."""
    folder.mkdir(parents=True)
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]

    def git(*arguments: str) -> str:
        return subprocess.check_output(["git", "-C", folder, *identity, *arguments], text=True).strip()

    git("init", "--quiet")
    git("config", "uploadpack.allowAnySHA1InWant", "true")
    git("config", "uploadpack.allowFilter", "true")
    commits = []
    for content in ("first", "second"):
        (folder / "walk.trc").write_text(content, encoding="utf-8")
        git("add", ".")
        git("commit", "--quiet", "--message", content)
        commits.append(git("rev-parse", "HEAD"))
    return commits


@pytest.mark.parametrize("cloned", [False, True])
def test_files_come_from_the_commit_of_a_mirror_or_a_clone(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], *, cloned: bool
) -> None:
    commits = repository_of_two_commits(tmp_path / ("host/lab/data.git" if cloned else "mirrors/lab+data"))
    plain = dataclasses.replace(ENTRIES[0], repository="lab/data", path="walk.trc", forces="", static="")
    entries = [dataclasses.replace(plain, commit=commit) for commit in commits]
    lost = dataclasses.replace(entries[0], path="lost.trc")
    into, mirrors = tmp_path / "into", None if cloned else tmp_path / "mirrors"
    strangers_list.fetch([*entries, lost], into, mirrors, f"file://{tmp_path}/host")
    read = [(into / entry.place / "walk.trc").read_text(encoding="utf-8") for entry in entries]
    assert read == ["first", "second"]
    assert capfd.readouterr().err == f"not fetched: lab/data {commits[0]}:lost.trc\n"


def test_a_clone_that_cannot_be_made_names_the_files_not_fetched(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    entry = dataclasses.replace(ENTRIES[0], repository="lab/none", path="walk.trc", forces="", static="")
    strangers_list.fetch([entry], tmp_path / "into", None, f"file://{tmp_path}/host")
    assert not (tmp_path / "into" / entry.place).exists()
    assert f"not fetched: lab/none {entry.commit}:walk.trc\n" in capfd.readouterr().err
