import json

import pytest

from stridelab.body import segment_tables
from stridelab.errors import InvalidInput

SEXES = ("female", "male", None)
TABLES = ("dumas2007", "deleva1996")


@pytest.mark.parametrize("sex", SEXES)
@pytest.mark.parametrize("name", TABLES)
def test_mass_fractions_sum_to_one(name, sex):
    table = segment_tables.load_table(name, sex)
    assert sum(row.mass_fraction for row in table.segments.values()) == pytest.approx(1.0, abs=1e-12)
    assert all(0 < row.mass_fraction < 0.5 for row in table.segments.values())


@pytest.mark.parametrize("name", TABLES)
def test_left_is_the_mirror_image_of_right(name):
    table = segment_tables.load_table(name, "male")
    for segment, row in table.segments.items():
        if segment.startswith("l_"):
            assert table.segments["r" + segment[1:]] == row.mirror_image()


@pytest.mark.parametrize("sex", SEXES)
@pytest.mark.parametrize("name", TABLES)
def test_json_round_trip_changes_nothing(name, sex):
    table = segment_tables.load_table(name, sex)
    assert segment_tables.from_json(segment_tables.to_json(table)) == table


def test_without_a_sex_the_table_is_the_mean_of_both():
    female, male, mean = (segment_tables.load_table("deleva1996", sex) for sex in SEXES)
    for segment, row in mean.segments.items():
        both = female.segments[segment], male.segments[segment]
        assert row.com == pytest.approx([(a + b) / 2 for a, b in zip(both[0].com, both[1].com, strict=True)])


# Table 4 of de Leva 1996 gives the same centre of mass for several choices of endpoints, each with its length in mm and
# the position from its first endpoint: the other rows must put it where the row we ship puts it.
@pytest.mark.parametrize(
    ("sex", "shipped_mm", "from_other_rows_mm"),
    [
        ("male", 242.9 * (1 - 0.4998), [203.3 * 0.5976]),  # head from the vertex: VERT-CERV against VERT-MIDG
        ("female", 243.7 * (1 - 0.5159), [200.2 * 0.5894]),
        ("male", 515.5 * (1 - 0.4310), [531.9 * (1 - 0.4486), 603.3 * (1 - 0.5138)]),  # trunk from mid-hip
        ("female", 497.9 * (1 - 0.3782), [529.3 * (1 - 0.4151), 614.8 * (1 - 0.4964)]),
        ("male", 440.3 * 0.4395, [434.0 * 0.4459, 427.7 * 0.4524]),  # shank from the knee: AJC, LMAL, SPHY
        ("female", 438.6 * 0.4352, [432.3 * 0.4416, 426.0 * 0.4481]),
    ],
)
def test_de_leva_rows_agree_with_their_alternatives(sex, shipped_mm, from_other_rows_mm):
    assert from_other_rows_mm == pytest.approx([shipped_mm] * len(from_other_rows_mm), abs=0.15)


def test_de_leva_trunk_is_the_sum_of_its_three_parts():
    male = segment_tables.load_table("deleva1996", "male").segments["trunk"].mass_fraction
    female = segment_tables.load_table("deleva1996", "female").segments["trunk"].mass_fraction
    assert male == pytest.approx(0.1596 + 0.1633 + 0.1117, abs=2e-4)
    assert female == pytest.approx(0.1545 + 0.1465 + 0.1247, abs=2e-4)


def test_the_shipped_rows_are_the_rows_checked_above():
    trunk, shank, head = (
        segment_tables.load_table("deleva1996", "male").segments[s] for s in ("trunk", "r_shank", "head_neck")
    )
    assert (trunk.com[1], shank.com[1], head.com[1]) == (-0.4310, -0.4395, 0.4998)


def _plain(**changes):
    return {"name": "own", "segments": {"pelvis": {"mass_fraction": 1.0 - 1e-9, "com": [0, 0, 0]}}} | changes


@pytest.mark.parametrize(
    "text",
    [
        "not json",
        "[]",
        json.dumps({"name": "own"}),
        json.dumps(_plain(segments={"pelvis": {"mass_fraction": 0.6, "com": [0, 0, 0]}})),
        json.dumps(_plain(segments={"pelvis": {"mass_fraction": 2.0, "com": [0, 0, 0]}})),
        json.dumps(_plain(segments={"pelvis": {"mass_fraction": 0.999, "com": [0, 0]}})),
        json.dumps(_plain(segments={"pelvis": {"mass_fraction": 0.999, "com": [0, 0, float("nan")]}})),
        json.dumps(_plain(segments=[1, 2])),
    ],
)
def test_an_invalid_table_is_refused(text):
    with pytest.raises(InvalidInput) as refusal:
        segment_tables.from_json(text)
    assert refusal.value.code == "segment-table-invalid"


def test_unknown_table_names_the_known_ones():
    with pytest.raises(InvalidInput, match="dumas2007") as refusal:
        segment_tables.load_table("../segment_tables/dumas2007", "male")
    assert refusal.value.code == "segment-table-unknown"
