"""Figure 3.3 and the numbers in the text, against closed forms, tables of statistics and theorems that are sharp."""

import numpy as np
import pytest
from scipy import stats

from stridelab.reproduction.chapter2 import numbers
from stridelab.reproduction.chapter3 import fig_3_3
from stridelab.reproduction.chapter3 import numbers as numbers_3
from stridelab.reproduction.chapter4 import numbers as numbers_4
from stridelab.reproduction.chapter4.table_4_1 import COLUMNS
from stridelab.reproduction.claims import Claim, Reproduction
from stridelab.reproduction.common.simulated_people import THESIS_SUBJECTS
from stridelab.reproduction.common.simulated_steps import simulated_steps
from stridelab.reproduction.studies.estimator_study import simulate_trial
from stridelab.walking.curtate_cycloid import Wheel

R, r = 0.10, 0.015


@pytest.fixture(scope="module")
def figure() -> Reproduction:
    return fig_3_3.run(range(1), lambda _fraction, _message: None)


def claim(found: Reproduction, key: str) -> Claim:
    return next(claim for claim in found.claims if claim.key == key)


def test_the_convex_part_of_a_cycloid_has_a_closed_form() -> None:
    """Between the bends: 2 (R arccos(r / R) - sqrt(r^2 - r^4 / R^2)) of 2 pi R."""
    closed = (R * np.arccos(r / R) - np.sqrt(r**2 - r**4 / R**2)) / (np.pi * R)
    assert fig_3_3.convex_share(Wheel(R_m=R, r_m=r, z0_m=0.9, x0_m=2.0)) == pytest.approx(closed, rel=1e-12)
    assert closed < 0.5


def test_the_three_types_differ_where_the_point_is_lowest(figure: Reproduction) -> None:
    """x' / (R theta') = 1 - (r / R) cos theta is least at the bottom."""
    for name, share in fig_3_3.TYPES.items():
        assert claim(figure, f"{name}_least_speed").ours == pytest.approx(1.0 - share, abs=1e-12)
        assert claim(figure, f"{name}_least_speed").verdict == "met"
    assert claim(figure, "convex_share").verdict == "thesis_in_error"
    table = figure.tables["cycloids"]
    assert (np.diff(table["prolate_x_m"]) < 0.0).any()
    assert (np.diff(table["curtate_x_m"]) > 0.0).all()


def test_without_gesticulation_the_com_is_on_the_axis() -> None:
    """What is off is f x L' / f^2, which another formula says."""
    trial = simulate_trial("robot", "none", 0)
    off = numbers._axis_offset_m(trial)
    f, L_rate = trial.truth.force_n, trial.truth.momentum_rate_nm
    expected = np.cross(f, L_rate) / np.sum(f * f, axis=1)[:, None]
    assert off == pytest.approx(expected, abs=1e-9)


def test_the_average_of_both_passes_is_what_the_estimator_gives() -> None:
    trial = simulate_trial("robot", "thesis", 0)
    both, one = numbers._passes_m(trial)
    assert 0.0 < both < one


def test_a_path_has_so_many_free_numbers_as_the_derivative_has_ranks() -> None:
    """Three of the shape and one angle per sample; six with an even clock. Without a radius nothing but a line."""
    theta = np.linspace(0.3, 6.0, 20)
    assert numbers_3.free_parameter_counts(theta, R, r) == (3 + len(theta), 6)
    assert numbers_3.free_parameter_counts(theta, R, 0.0)[1] < 6


def test_the_printed_coefficients_have_the_p_of_students_t() -> None:
    result = {c.key: c for c in numbers_3._p_value_claims()}
    for name, coefficient, bound in numbers_3.PRINTED:
        t = coefficient * np.sqrt((THESIS_SUBJECTS - 2) / (1.0 - coefficient**2))
        p = 2.0 * stats.t.sf(t, THESIS_SUBJECTS - 2)
        assert result[f"{name}_p"].ours == pytest.approx(p, rel=1e-9)
        assert result[f"{name}_p"].verdict == ("met" if p < bound else "not_met")
    assert result["r_p"].verdict == "not_met"
    assert "one-sided 0.0061" in result["r_p"].note, "which is below the bound"


def test_the_factor_of_an_inner_ellipsoid_is_that_of_johns_theorem() -> None:
    """Sharp for a simplex (1 / d) and for a cross (1 / sqrt(d)); no cloud has less."""
    assert min(numbers_4.shrinking_factors(symmetric=False)) == pytest.approx(1.0 / 5.0, abs=1e-6)
    assert min(numbers_4.shrinking_factors(symmetric=True)) == pytest.approx(1.0 / np.sqrt(5.0), abs=1e-6)


def test_facets_hold_their_rays_and_grow_with_the_contacts() -> None:
    two, three = numbers_4.facet_counts(2), numbers_4.facet_counts(3)
    assert 0.0 <= max(two.largest_violation, three.largest_violation) < 1e-9
    assert three.median_number > 2.0 * two.median_number


def test_the_hub_varies_more_than_the_walker_whom_it_is_to_smooth() -> None:
    """On an exact cycloid that turns evenly the hub is even and the point is not; on a walk it is the other way."""
    for fit in simulated_steps().fits:
        hub, com = numbers_3.speed_variations(fit)
        assert hub > 2.0 * com
        t = np.linspace(0.0, 1.0, len(fit.time_s))
        theta = 2.0 * np.pi * t - np.pi
        even = fit.path.wheel
        assert np.gradient(even.hub_m(theta)[:, 0], t) == pytest.approx(np.full(len(t), 2.0 * np.pi * even.R_m))


def test_table_4_1_contradicts_its_own_summary() -> None:
    """10 s in 15 iterations on 36 s of motion; the text has 15 ms at most."""
    each_ms = {
        (c.experiment, c.control): 1e3 * c.time_s / c.iterations / c.duration_s
        for c in COLUMNS
        if np.isfinite(c.time_s)
    }
    assert each_ms[3, "u_c"] == pytest.approx(18.5, abs=0.05)
    assert [each_ms[1, "u_c"], each_ms[1, "u_f"], each_ms[2, "u_c"]] == pytest.approx([7.0, 12.2, 7.9], abs=0.05)
    assert 17.0 * each_ms[1, "u_f"] == pytest.approx(207.0, abs=1.0)
