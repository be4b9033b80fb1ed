"""Which mass is used follows from the errors of all masses that are known, and every choice is said."""

import pytest

from stridelab.errors import InvalidInput, NotEstimable
from stridelab.pipelines.mass_and_latency import BodyMass, body_mass
from stridelab.recordings.body_mass import MassEstimate


def impulse(mass_kg: float, sd_kg: float = 0.3) -> tuple[MassEstimate, ...]:
    return (MassEstimate(mass_kg, sd_kg, "impulse", 0.9),)


def standing(mass_kg: float, sd_kg: float = 0.1) -> tuple[MassEstimate, ...]:
    return (MassEstimate(mass_kg, sd_kg, "standing", 2.0),)


@pytest.mark.parametrize(
    ("stated", "in_file", "measured", "used", "source", "codes"),
    [
        (60.0, 70.0, impulse(61.0), 60.0, "stated", []),
        (None, 70.0, impulse(70.5), 70.0, "file", []),
        (None, None, impulse(61.0), 61.0, "force", ["mass-from-force"]),
        (60.0, None, (), 60.0, "stated", []),
        (60.0, None, impulse(63.2, 1.5), 60.0, "stated", ["mass-differs-from-force"]),
        (60.0, None, impulse(66.5), 66.5, "force", ["mass-disagrees-with-force"]),
        (None, 70.0, impulse(62.0), 62.0, "force", ["mass-disagrees-with-force"]),
        (None, 7.0, impulse(66.0), 66.0, "force", ["mass-contradicts-force"]),
    ],
)
def test_which_mass_counts(  # type: ignore[no-untyped-def]
    stated, in_file, measured, used, source, codes
) -> None:
    mass = body_mass(stated, in_file, measured)
    assert (mass.mass_kg, mass.source) == (pytest.approx(used), source)
    assert [remark.code for remark in mass.remarks] == codes


def test_a_scale_and_an_impulse_together_win_over_the_file() -> None:
    """A child that the file states with 25.0 kg stands on a plate with 27.2 kg and walks with 27.1 kg."""
    mass = body_mass(None, 25.0, impulse(27.1, 0.15), standing(27.2))
    assert mass.source == "force"
    assert mass.mass_kg == pytest.approx(27.17, abs=0.05)
    (remark,) = mass.remarks
    assert "27.1 ± 0.3 kg (impulse of the vertical force)" in remark.message
    assert "27.2 ± 0.3 kg (standing in the static trial)" in remark.message
    assert "25 kg (in the file)" in remark.message
    assert [(known.source, known.mass_kg) for known in mass.compared] == [
        ("file", 25.0),
        ("impulse", 27.1),
        ("static", 27.2),
    ]


def test_the_standard_deviation_is_of_the_mass_that_is_used() -> None:
    assert body_mass(60.0, None, impulse(60.5)).sd_kg == pytest.approx((0.3**2 + 0.6**2) ** 0.5)
    assert body_mass(None, None, impulse(60.0)).sd_kg == pytest.approx((0.3**2 + 0.6**2) ** 0.5)


def test_a_movement_may_hide_missing_force_a_scale_may_not() -> None:
    """Less force than the stated weight needs may be a part of a foot beside the plate; more force may not."""

    def source(measured: tuple[MassEstimate, ...]) -> str | None:
        return body_mass(66.5, None, measured).source

    assert source(impulse(62.0)) == "stated"
    assert source(standing(62.0)) == "force"
    assert source(impulse(71.0)) == "force"


def test_the_remark_says_what_the_other_mass_would_cost() -> None:
    mass: BodyMass = body_mass(60.0, None, impulse(69.0))
    (remark,) = mass.remarks
    assert "60 kg" in remark.message
    assert "69.0 ± 0.8 kg are used" in remark.message
    assert "+15%" in remark.message
    assert "1.5 m/s²" in remark.message
    assert "beside the plates" not in remark.message


def test_an_uncertain_impulse_accuses_nobody() -> None:
    """A jump weighs a person with an error of kilograms: no remark says that mass or calibration is wrong."""
    assert body_mass(63.5, None, impulse(61.3, 1.9)).remarks == ()


@pytest.mark.parametrize("stated", [6.1, 130.0, 390.0])
def test_an_absurd_mass_is_refused_naming_the_field(stated: float) -> None:
    with pytest.raises(InvalidInput) as refusal:
        body_mass(stated, None, impulse(61.0))
    assert refusal.value.code == "mass-contradicts-force"
    assert refusal.value.faults[0].where == "mass_kg"


def test_no_mass_at_all_is_refused() -> None:
    with pytest.raises(NotEstimable) as refusal:
        body_mass(None, None, ())
    assert refusal.value.code == "mass-unknown"
    assert refusal.value.faults[0].where == "mass_kg"
    assert "geometry needs no mass" in refusal.value.message


def test_where_no_mass_is_required_the_nominal_one_is_not_known() -> None:
    nominal = body_mass(None, None, (), required=False)
    assert (nominal.known_kg, nominal.known_sd_kg, nominal.source) == (None, None, None)
    assert body_mass(61.0, None, (), required=False) == body_mass(61.0, None, ())
