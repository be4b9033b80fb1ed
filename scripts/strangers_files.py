"""Finds recordings below folders, and the files that belong to each: forces, body model, static trial.

Used by scripts/survey_recordings.py. File names decide; a wrong guess is an outcome of the survey.
"""

import glob
import hashlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import strangers_list

STATIC_WORDS: Final = ("static", "standing")
ANGLES: Final = re.compile(r"_?(IK|ik|kinematics|Kinematics|coordinates)(?!_u|_dudt|[a-z])_?(results?)?")
"""In the name of a file of joint angles that inverse kinematics computed."""
SCALED: Final = re.compile(r"scal|adjust|subject|personal", re.IGNORECASE)
FORCE_WORDS: Final = ("", "_grf", "_forces", "_force", "_grfs", "grf", "_ExtLoads", "_GRF")


class Trial(NamedTuple):
    """One recording: its source, its name there, its file, the files that go with it into a zip, its static trial."""

    source: str
    name: str
    path: Path
    others: tuple[Path, ...]
    static: Path | None


def recordings_below(folder: Path) -> Iterator[Path]:
    """Recordings of all formats, each content once."""
    digests: set[str] = set()
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or not is_recording(path):
            continue
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if digest not in digests:
            digests.add(digest)
            yield path


def is_recording(path: Path) -> bool:
    """Whether a file holds markers, or joint angles from inverse kinematics beside which a model lies."""
    suffix = path.suffix.lower()
    if suffix in {".c3d", ".trc", ".mvnx"}:
        return True
    if suffix in {".tsv", ".csv"}:
        return (
            path.read_bytes()[:200]
            .lstrip(b"\xef\xbb\xbf \r\n")
            .startswith((b"NO_OF_FRAMES", b"Trajectories", b"Devices"))
        )
    if suffix in {".mot", ".sto"} and ANGLES.search(path.stem):
        head = path.read_bytes()[:20_000]
        return b"endheader" in head and b"pelvis_tx" in head and model_of(path) is not None
    return False


def model_of(angles: Path) -> Path | None:
    """The OpenSim model of joint angles: in their folder, else in the nearest above or beside; a scaled one first."""
    for place in (angles.parent, angles.parent.parent):
        models = sorted(place.glob("*.osim")) or sorted(place.glob("*/*.osim"))
        scaled = [path for path in models if SCALED.search(path.stem)]
        if models:
            return (scaled or models)[0]
    return None


def others_of(path: Path) -> tuple[Path, ...]:
    """The files that go into one zip with a recording."""
    suffix = path.suffix.lower()
    if suffix == ".tsv":
        return tuple(sorted(path.parent.glob(f"{glob.escape(path.stem)}_f_*.tsv")))
    forces = force_file_of(path) if suffix in {".trc", ".mot", ".sto"} else None
    model = model_of(path) if suffix in {".mot", ".sto"} else None
    return tuple(other for other in (forces, model) if other is not None)


def force_file_of(trc: Path) -> Path | None:
    """The force file of a TRC file or of joint angles: beside it, or in another folder of its parent."""
    places = [trc.parent, *(path for path in trc.parent.parent.iterdir() if path.is_dir())]
    plain = ANGLES.sub("", trc.stem) if trc.suffix.lower() != ".trc" else trc.stem
    stems = [f"GRF_{plain.strip('_')}", *(plain.rstrip("_") + word for word in FORCE_WORDS)]
    names = {f"{stem}{suffix}".lower() for stem in stems for suffix in (".mot", ".sto")}
    for place in places:
        for path in sorted(place.iterdir()):
            if path.name.lower() in names and b"force" in path.read_bytes()[:4000].lower():
                return path
    return None


def static_trial_of(path: Path) -> Path | None:
    """The static trial beside a recording whose name is the most like its own, else the only one in folders beside."""

    def n_shared_words(other: Path) -> int:
        words, others = (set(re.split(r"[\W_]+", place.stem.lower())) for place in (path, other))
        return len(words & others)

    for places in ([path.parent], [place for place in path.parent.parent.iterdir() if place.is_dir()]):
        candidates = [
            other
            for place in places
            for other in sorted(place.iterdir())
            if any(word in other.name.lower() for word in STATIC_WORDS)
            and other.suffix.lower() == path.suffix.lower()
            and other != path
        ]
        if places == [path.parent]:
            best = max(map(n_shared_words, candidates), default=0)
            candidates = [other for other in candidates if n_shared_words(other) == best]
        if len(candidates) == 1:
            return candidates[0]
    return None


def trials_below(folder: Path) -> Iterator[Trial]:
    """The recordings below a folder, with the files that seem to belong to them."""
    for path in recordings_below(folder):
        yield Trial(folder.name, str(path.relative_to(folder)), path, others_of(path), static_trial_of(path))


def listed_trials(entries: Sequence[strangers_list.Entry], folder: Path) -> Iterator[Trial]:
    """The recordings of the list that lie below the folder into which they were fetched."""
    for entry in entries:
        place = folder / entry.place
        if (place / entry.path).exists():
            others = tuple(place / other for other in entry.others)
            source, name = entry.key
            yield Trial(source, name, place / entry.path, others, place / entry.static if entry.static else None)
