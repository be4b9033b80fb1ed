"""The table of real walks: figures that can be told from independent computations, on two persons of each study."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotFound
from stridelab.reproduction.chapter2 import table_real_walks
from stridelab.reproduction.claims import Reproduction

ADULTS, CHILDREN = ("2014001", "2014015"), ("HC002D", "HC030A")


@pytest.fixture(scope="module")
def found(gait: Path, tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    few = tmp_path_factory.mktemp("gait")
    for study, persons in (("rehazenter-adult-walking", ADULTS), ("biomechzoo-sample-study", CHILDREN)):
        (few / study).mkdir()
        for person in persons:
            (few / study / person).symlink_to((gait / study / person).resolve())
    return table_real_walks.run(few, lambda _fraction, _message: None)


def by(columns: Mapping[str, np.ndarray], key: str, value: str) -> dict[str, float]:
    """``value`` by the words of ``key``."""
    return dict(zip(columns[key].tolist(), columns[value].tolist(), strict=True))


def test_every_estimator_is_in_every_group(found: Reproduction) -> None:
    table = found.tables["agreement"]
    assert len(table["estimator"]) == len(table_real_walks.ESTIMATORS) * len(table_real_walks.GROUPS)
    assert set(table["n"].tolist()) == {2}


def test_the_geometry_does_not_read_the_force(found: Reproduction) -> None:
    """Its residual is the same where the force is held back, and it is not offset from itself."""
    table = found.tables["agreement"]
    alone = table["estimator"] == "geometry"
    for axis in "xyz":
        assert table[f"held_back_{axis}"][alone] == pytest.approx(table[f"residual_{axis}"][alone], rel=1e-9)
    assert np.abs(table["offset_x_m"][alone]).max() < 1e-12


def test_what_was_fused_fits_better_than_what_was_held_back(found: Reproduction) -> None:
    table = found.tables["agreement"]
    fused = np.isin(table["estimator"], ["complementary", "rts", "smoother"])
    assert (table["residual_x"][fused] < table["held_back_x"][fused]).all()


def test_who_stands_still_stands_over_the_centre_of_pressure(found: Reproduction) -> None:
    """The force tells the horizontal CoM of a person who stands; the segment table alone is millimetres off."""
    still = by(found.tables["standing"], "estimator", "still_m")
    assert still["smoother"] < 0.002
    assert still["complementary"] < 0.002
    assert still["geometry"] > 0.004


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound) as refused:
        table_real_walks.run(tmp_path, lambda _fraction, _message: None)
    assert refused.value.code == "recordings-missing"
