"""The table of real walks: figures that follow from independent computations, on two persons of each study."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from stridelab.errors import NotFound
from stridelab.recordings.reader import read_recording
from stridelab.reproduction.chapter2 import table_real_walks
from stridelab.reproduction.claims import Reproduction
from stridelab.reproduction.common.intervals import rms_ratio
from support.recorded_claims import assert_as_recorded, assert_steps_as_recorded, assert_tables_as_recorded
from support.recorded_steps import recorded_steps
from support.recordings.walks import cut_recording, link_adults, link_people

ADULTS, CHILDREN = ("2014001", "2014015"), ("HC002D", "HC030A")


@pytest.fixture(scope="module")
def found(gait: Path, tmp_path_factory: pytest.TempPathFactory) -> Reproduction:
    few = tmp_path_factory.mktemp("gait")
    for study, persons in (("rehazenter-adult-walking", ADULTS), ("biomechzoo-sample-study", CHILDREN)):
        link_people(gait / study, persons, few / study)
    cut_recording(gait, few, table_real_walks.GROUPS["children"])
    with recorded_steps() as steps:
        result = table_real_walks.run(few, lambda _fraction, _message: None)
    assert_steps_as_recorded(table_real_walks.NAME, steps)
    return result


def test_what_verdicts_on_four_people_stand_on_is_as_recorded(found: Reproduction) -> None:
    assert_as_recorded(table_real_walks.NAME, found.claims)
    assert_tables_as_recorded(table_real_walks.NAME, found.tables)


def by(columns: Mapping[str, np.ndarray], key: str, value: str) -> dict[str, float]:
    """``value`` by the words of ``key``."""
    return dict(zip(columns[key].tolist(), columns[value].tolist(), strict=True))


def test_every_estimator_is_in_every_group_and_means_compare_the_same_walks(found: Reproduction) -> None:
    table = found.tables["agreement"]
    assert len(table["estimator"]) == len(table_real_walks.ESTIMATORS) * len(table_real_walks.GROUPS)
    assert set(table["n"].tolist()) == {2}
    for group in table_real_walks.GROUPS:
        held = set(table["n_held"][table["walks"] == group].tolist())
        assert len(held) == 1
        assert held <= {0, 1, 2}
    assert "2014015_C" in found.note  # where the smoother has no held-back force
    assert "Left out: cut/Straight" in found.note


def test_the_geometry_is_not_offset_from_itself_and_is_the_baseline_of_every_distance(found: Reproduction) -> None:
    table = found.tables["agreement"]
    alone = table["estimator"] == "geometry"
    assert np.abs(table["offset_x_m"][alone]).max() < 1e-12
    distances = [claim for claim in found.claims if "path" in claim.key or "standing" in claim.key]
    assert len(distances) == 2 * len(table_real_walks.GROUPS) + 2
    for claim in distances:
        assert claim.comparator == "geometry"
        assert claim.interval is not None
        assert claim.interval[0] <= claim.ours <= claim.interval[1]


def test_a_ratio_of_paired_people_is_certain_where_all_agree_and_not_where_one_decides() -> None:
    ratio, interval = rms_ratio([1.0, 4.0, 9.0], [4.0, 16.0, 36.0])
    assert interval == (ratio, ratio)
    assert ratio == pytest.approx(0.5)
    ratio, interval = rms_ratio([1.0, 1.0, 100.0], [4.0, 4.0, 4.0])
    assert interval == pytest.approx((0.5, 5.0))
    assert ratio == pytest.approx(np.sqrt(102 / 12))
    assert rms_ratio([-1.0, -1.0], [1.0, 1.0]) == (0.0, (0.0, 0.0)), "a penalty may exceed the distance"


@pytest.mark.parametrize("person", CHILDREN)
def test_the_standing_truth_is_the_distance_that_the_geometry_has_from_the_pressure(gait: Path, person: str) -> None:
    """Two computations: the plates' own moments in the body's axes, and the check of the estimators in the world's."""
    folder = gait / "biomechzoo-sample-study" / person
    truth = table_real_walks._table_error_m(folder)
    still = table_real_walks._standing_distance_m(folder)["geometry"]
    assert np.hypot(truth[0], truth[1]) == pytest.approx(still, abs=0.001)


def test_the_mass_of_a_child_is_what_the_plates_carry(gait: Path) -> None:
    folder = gait / "biomechzoo-sample-study" / "HC030A"
    (path,) = folder.glob("Static*.c3d")
    carried = sum(plate.force_n[:, 2] for plate in read_recording(path).plates)
    mass_kg = table_real_walks._standing_mass_kg(folder)
    assert mass_kg == pytest.approx(np.median(carried) / 9.81, rel=0.005)
    assert table_real_walks._standing_mass_kg(gait / "rehazenter-adult-walking" / "2014001") is None


def test_who_stands_still_stands_over_the_centre_of_pressure(found: Reproduction) -> None:
    """The force tells the horizontal CoM of a person who stands; the segment table alone is millimetres off."""
    still = by(found.tables["standing"], "estimator", "still_m")
    assert still["smoother"] < 0.002
    assert still["complementary"] < 0.002
    assert still["geometry"] > 0.004


def test_one_adult_gives_what_adults_give_and_the_note_names_the_missing_children(gait: Path, tmp_path: Path) -> None:
    result = table_real_walks.run(link_adults(gait, ADULTS[:1], tmp_path), lambda _fraction, _message: None)
    assert "Missing: children (" in result.note
    assert {claim.key.partition(" ")[0] for claim in result.claims} == {
        "adults,",
        "speed_smoother",
        "speed_complementary",
    }
    assert all(claim.evidence == "people" and claim.n == 1 for claim in result.claims)
    assert result.tables["standing"]["estimator"].tolist() == []
    assert set(result.tables["agreement"]["walks"].tolist()) == {"adults, comfortable", "adults, fast"}


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(NotFound) as refused:
        table_real_walks.run(tmp_path, lambda _fraction, _message: None)
    assert refused.value.code == "recordings-missing"
