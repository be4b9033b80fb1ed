"""Arrange clones of public recordings of people as the book reads them: ``arrange_recordings.py CLONES FOLDER``.

CLONES holds the clones of the repositories of ``SETS`` that there are; FOLDER/gait gets copies of their recordings, the
folders of people by set. docs/reproduction.md names the repositories, the studies and their DOIs.
"""

import argparse
import hashlib
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

SETS: Final[Mapping[str, tuple[str, str, str]]] = {
    "rehazenter-adult-walking": (
        "zmp-opensim/datasets/SchreiberMoissenet2019/data",
        r"(\w+)/(?:dynamic|static)/(\w+\.c3d)",
        r"\1/\2",
    ),
    "running": (
        "zmp-opensim/datasets/HamnerDelp2013/data",
        r"(\w+)/(?:expData|model)/(Run_[2-5]\.trc|Run_[2-5]_grf\.mot|static\.trc)",
        r"\1/\2",
    ),
    "biomechzoo-sample-study": (
        "biomechzoo/data/sample_study/raw c3d files",
        r"(\w+)/(Static|Straight|Turn)/(\w+\.c3d)",
        r"\1/\2_\3",
    ),
    "pycgm-stairs": ("pyCGM/SampleData/Test_Files", r"((?:Movement|Static)_trial\.c3d)", r"\1"),
}
"""Folder below ``gait``; folder below the clones, its files, and their names in ours (regular expressions)."""


def arranged_files(clones: Path, name: str) -> Iterator[tuple[Path, str]]:
    """Files of one set in the clones, and their places below ``gait``; none without its clone."""
    folder, files, place = SETS[name]
    for path in sorted((clones / folder).rglob("*")):
        match = re.fullmatch(files, path.relative_to(clones / folder).as_posix())
        if match is not None:
            yield path, f"{name}/{match.expand(place)}"


def digest_of_contents(folder: Path) -> tuple[int, str]:
    """Number of files below a folder, and the SHA-256 of their names and contents in the order of the names."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(folder).as_posix()}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    return len(files), digest.hexdigest()


def main() -> None:
    """Copy the files of each set; at the end say how many, which sets are missing, and the digest of all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clones", type=Path)
    parser.add_argument("folder", type=Path)
    arguments = parser.parse_args()
    counts = dict.fromkeys(SETS, 0)
    for name in SETS:
        for path, place in arranged_files(arguments.clones, name):
            target = arguments.folder / "gait" / place
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, target)
            counts[name] += 1
    for name, count in counts.items():
        sys.stdout.write(
            f"{name}: " + (f"{count} files\n" if count else f"missing, {arguments.clones / SETS[name][0]}\n")
        )
    if not any(counts.values()):
        sys.exit("No recordings were found.")
    sys.stdout.write("{} files, SHA-256 {}\n".format(*digest_of_contents(arguments.folder / "gait")))


if __name__ == "__main__":
    main()
