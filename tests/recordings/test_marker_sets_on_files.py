"""Every real file is recognised as the set it was recorded with."""

from pathlib import Path

import ezc3d
import pytest

from stridelab.recordings.marker_sets import identify

SETS = {
    "rehazenter-adult-walking": "isb",
    "biomechzoo-sample-study": "plug-in-gait",
    "pycgm-stairs": "plug-in-gait",
    "ezc3d-testfiles/Qualisys.c3d": "isb-head",
    "ezc3d-testfiles/BTS.c3d": "davis-lower",
    "ezc3d-testfiles/FP_Type3.c3d": None,
    "opensim-core/gait2354-subject01": "gait2354",
    "opensim-core/rajagopal-walk": "rajagopal",
    "opensim-core/walking2.c3d": "uwa-trunk",
    "kineticstoolkit": "cgm2-lower",
    "rtosim-treadmill": "uwa-lower",
}


def labels_of(path: Path) -> list[str]:
    if path.suffix == ".trc":
        names = path.read_text(encoding="utf-8").splitlines()[3].split("\t")[2:]
        return [name.strip() for name in names if name.strip()]
    return list(ezc3d.c3d(str(path))["parameters"]["POINT"]["LABELS"]["value"])


@pytest.mark.parametrize("place", sorted(SETS))
def test_the_set_of_every_file(gait, place):
    here = gait / place
    files = [here] if here.is_file() else [*here.rglob("*.c3d"), *here.rglob("*.trc")]
    assert files
    set_names = {path.name: identify(labels_of(path)).name for path in files}
    assert set(set_names.values()) == {SETS[place]}, set_names


def test_every_folder_of_files_is_tested(gait):
    files = [*gait.rglob("*.c3d"), *gait.rglob("*.trc")]
    covered = [path for path in files if any(str(path.relative_to(gait)).startswith(place) for place in SETS)]
    assert len(covered) == len(files) == 65


def test_a_file_of_an_unknown_set_names_the_nearest_sets(gait):
    match = identify(labels_of(gait / "ezc3d-testfiles" / "FP_Type3.c3d"))
    assert len(match.nearest) == 3
    assert all(match.needed[name] for name, _ in match.nearest)
