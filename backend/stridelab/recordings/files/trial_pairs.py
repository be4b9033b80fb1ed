"""Finds the ground forces of an OpenSim trial by the names of its files: ``walk.trc`` and ``walk_grf.mot``."""

import re
import shutil
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath
from typing import Final, TypeVar

from stridelab.recordings.files.opensim_zip import has_ground_forces

TRC: Final = ".trc"
FORCES: Final = (".mot", ".sto")
FORCE_FOLDERS: Final = ("forcedata", "forces", "force", "grf", "id", "kinetics")
"""Folders beside that of the markers in which forces are sought, in lower case."""
HEAD_BYTES: Final = 20_000
_FORCE_WORDS: Final = re.compile(r"([\W_]*(external|forces?|grfs?|ground|kinetics|loads?|reactions?))+$", re.IGNORECASE)
_MARKER_WORDS: Final = re.compile(r"([\W_]*(experimental|markers?|trajectories))+$", re.IGNORECASE)
_P = TypeVar("_P", bound=PurePath)


def pair_trials(trials: Iterable[_P], forces: Iterable[_P]) -> dict[_P, _P]:
    """The force file of each trial that has exactly one, whose name says the same, in its folder or in one for forces.

    Names are compared without what only says that a file holds forces or markers. A force file that would belong to
    several trials belongs to none.
    """
    trials, forces = list(trials), list(forces)
    found: dict[_P, _P] = {}
    for trial in trials:
        same = [one for one in forces if _name_without(_FORCE_WORDS, one) == _name_without(_MARKER_WORDS, trial)]
        beside = [one for one in same if one.parent == trial.parent]
        near = [one for one in same if _is_force_folder_beside(one.parent, trial.parent)]
        candidates = beside or near
        if len(candidates) == 1:
            found[trial] = candidates[0]
    claims = list(found.values())
    return {trial: force for trial, force in found.items() if claims.count(force) == 1}


def forces_beside(trial: Path) -> Path | None:
    """The file of ground forces that belongs to a TRC file on the disk, as in ``pair_trials``, or None.

    Only files whose names say the same are opened.
    """
    if trial.suffix.lower() != TRC:
        return None
    trial = trial.absolute()
    name = _name_without(_MARKER_WORDS, trial)
    near = [one for one in trial.parent.parent.glob("*") if _is_force_folder_beside(one, trial.parent)]
    files = [path for folder in (trial.parent, *near) for path in sorted(folder.glob("*")) if path.is_file()]
    alike = [path for path in files if path.suffix.lower() in FORCES and _name_without(_FORCE_WORDS, path) == name]
    trials = [path for path in files if path.suffix.lower() == TRC]
    return pair_trials(trials, filter(_holds_forces, alike)).get(trial)


def copy_recording(recording: Path, target: Path) -> None:
    """Write a recording to ``target``: a copy, or a zip with the forces that are beside a TRC file."""
    forces = forces_beside(recording)
    pack_trial((recording,) if forces is None else (recording, forces), target)


def pack_trial(files: Sequence[Path], target: Path) -> None:
    """Write the files of one trial, whose names differ, as one file: a copy of one, a zip of several."""
    if len(files) == 1:
        shutil.copyfile(files[0], target)
        return
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in files:
            packed.write(path, path.name)


def _name_without(words: re.Pattern[str], path: PurePath) -> str:
    return words.sub("", path.stem).lower()


def _is_force_folder_beside(folder: PurePath, markers: PurePath) -> bool:
    return folder.parent == markers.parent and folder != markers and folder.name.lower() in FORCE_FOLDERS


def _holds_forces(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return has_ground_forces(file.read(HEAD_BYTES).decode("utf-8-sig", errors="replace"))
    except OSError:
        return False
