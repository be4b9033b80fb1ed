"""The recordings of public repositories that the survey expects: ``strangers.tsv``, see scripts/strangers.

The list states for every recording its repository on GitHub, commit and path, the files of its forces and its static
trial, what is marked, whether marker sets or rules were made with its source, and the outcome of the last survey. The
recordings themselves are not part of the project.
"""

import csv
import dataclasses
import itertools
import re
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final, Literal

LIST: Final = Path(__file__).with_name("strangers.tsv")
ESTIMATES: Final = ("fused", "geometry")
PROMISOR: Final = ["config", "remote.origin.promisor", "true"]
"""Git then fetches a file when it is shown."""
HOST: Final = "https://github.com"
OTHER_PERSON: Final = 1.3
"""Ratio of two masses that are next to one another in a folder above which they are of two people."""
SESSION_SHARE: Final = 0.015
"""How far a trial's mass may be from that of its session."""
RUNNING: Final = re.compile(r"(?<![a-z])(run|sprint|jog)", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class Entry:
    """One recording; ``forces`` and ``static`` are paths at the same commit, or empty.

    ``forces`` may name several files, separated by semicolons: of several plates, or a body model and forces.

    ``marked``: ``body`` for pelvis, legs and trunk; ``legs`` for pelvis and legs; ``static`` where only a static trial
    that the repository lacks marks the knees; ``other`` for the rest. ``plates`` counts the plates with force.
    ``outcome`` is ``fused``, ``geometry``, ``contradicted``, or the code of an error; ``first`` the outcome with the
    program as it was when the recording was first met, empty where that was not recorded.
    """

    repository: str
    commit: str
    path: str
    forces: str
    static: str
    use: Literal["tuned", "held-out"]
    marked: Literal["body", "legs", "static", "other"]
    plates: int
    outcome: str
    first: str = ""

    @property
    def place(self) -> str:
        """The folder of its files below that into which the list is fetched."""
        return f"{self.repository.replace('/', '+')}/{self.commit[:12]}"

    @property
    def others(self) -> list[str]:
        """Paths of the files that are read together with the recording."""
        return [name for name in self.forces.split(";") if name]

    @property
    def key(self) -> tuple[str, str]:
        """Source and path of its row in the survey."""
        return self.repository, f"{self.commit[:12]}/{self.path}"

    @property
    def is_running(self) -> bool:
        """Whether its name calls it a run or a sprint, and not the static trial of one."""
        path = self.path.lower()
        return RUNNING.search(path) is not None and "static" not in path and "calib" not in path


def read_list(path: Path = LIST) -> list[Entry]:
    """The entries of a list."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        return [Entry(**{**row, "plates": int(row["plates"])}) for row in rows]  # type: ignore[arg-type]


def write_list(entries: Iterable[Entry], path: Path = LIST) -> None:
    """Write the entries in order, one a line."""
    names = [field.name for field in dataclasses.fields(Entry)]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter="\t", quoting=csv.QUOTE_NONE, quotechar=None, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(sorted(dataclasses.astuple(entry) for entry in entries))


def outcome_of(row: dict[str, Any]) -> str:
    """The outcome of a row of the survey, as an entry states it."""
    if row["outcome"] != "estimate":
        return str(row["outcome"])
    if row["verdict"] == "contradicted":
        return "contradicted"
    return "geometry" if row["method"] == "geometry" else "fused"


def fetch(entries: Sequence[Entry], folder: Path, mirrors: Path | None, host: str = HOST) -> None:
    """Extract the files of the list below a folder, from clones of the repositories at ``host`` or from mirrors.

    A mirror is a Git directory named ``owner+name`` or ``owner+name/repo``. Files that it lacks are named on stderr.
    """
    for entry in entries:
        for name in (entry.path, *entry.others, entry.static):
            to = folder / entry.place / name
            if not name or to.exists():
                continue
            git_show = subprocess.run(
                ["git", "-C", _repository(entry, folder, mirrors, host), "show", f"{entry.commit}:{name}"],
                capture_output=True,
                check=False,
            )
            if git_show.returncode:
                sys.stderr.write(f"not fetched: {entry.repository} {entry.commit}:{name}\n")
                continue
            to.parent.mkdir(parents=True, exist_ok=True)
            to.write_bytes(git_show.stdout)


def _repository(entry: Entry, folder: Path, mirrors: Path | None, host: str) -> Path:
    """The Git directory of an entry's repository, with its commit."""
    name = entry.repository.replace("/", "+")
    if mirrors is not None:
        mirror = mirrors / name
        return mirror / "repo" if (mirror / "repo").exists() else mirror
    clone = folder / ".git-clones" / name
    if not clone.exists():
        address = f"{host}/{entry.repository}.git"
        clone.mkdir(parents=True)
        for command in (["init", "--quiet", "--bare"], ["remote", "add", "origin", address], PROMISOR):
            subprocess.run(["git", "-C", clone, *command], check=True)
    if subprocess.run(["git", "-C", clone, "cat-file", "-e", entry.commit], check=False).returncode:
        command = ["fetch", "--quiet", "--depth", "1", "--filter=blob:none", "origin", entry.commit]
        subprocess.run(["git", "-C", clone, *command], check=False)
    return clone


def differences(entries: Sequence[Entry], rows: Sequence[dict[str, Any]]) -> list[str]:
    """One sentence for each recording whose outcome is not that of the list."""
    outcomes = {(row["source"], row["path"]): outcome_of(row) for row in rows}
    sentences = []
    for entry in entries:
        outcome = outcomes.get(entry.key, "not surveyed")
        if outcome != entry.outcome:
            sentences.append(f"{entry.repository} {entry.path}: {outcome}, expected {entry.outcome}")
    return sentences


def renewed(entries: Sequence[Entry], rows: Sequence[dict[str, Any]]) -> list[Entry]:
    """The entries with the outcomes of a survey."""
    outcomes = {(row["source"], row["path"]): outcome_of(row) for row in rows}
    return [dataclasses.replace(entry, outcome=outcomes.get(entry.key, entry.outcome)) for entry in entries]


def sessions_of(rows: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Rows of two trials or more of one person: of one folder, the same plates and rates, and masses that are alike.

    Trials with equal masses are one trial, published twice.
    """
    groups: dict[tuple[str, str, str], dict[float, dict[str, Any]]] = {}
    for row in rows:
        if row.get("weighed_kg"):
            folder = str(row["path"]).rpartition("/")[0]
            group = groups.setdefault((row["source"], folder, row["equipment"]), {})
            group.setdefault(round(row["weighed_kg"][0], 3), row)
    sessions = []
    for group in groups.values():
        masses = sorted(group)
        ends = [i for i, (a, b) in enumerate(itertools.pairwise(masses), 1) if b > OTHER_PERSON * a]
        for first, last in itertools.pairwise([0, *ends, len(masses)]):
            if last - first > 1:
                sessions.append([group[mass] for mass in masses[first:last]])
    return sessions
