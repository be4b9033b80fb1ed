"""Studies of simulated people with known laws: groups, correlations and remarks."""

import numpy as np
import pytest

from stridelab.walking.population.population import (
    COVARIATES,
    PARAMETERS,
    Pair,
    Person,
    Population,
    StepRow,
    assign_group,
    study,
    subject_means,
)


def lab(
    n: int, *, seed: int = 0, group: str = "adults", steps: int = 4, height: float = 1.72, recordings: int = 2
) -> tuple[list[Person], list[StepRow]]:
    """R goes with the step length, z0 with the height, omega with the speed; r with nothing."""
    rng = np.random.default_rng(seed)
    people, rows = [], []
    for i in range(n):
        name, height_m = f"{group}-{i:02d}", float(rng.normal(height, 0.08))
        people.append(Person(name=name, group=group, height_m=height_m, leg_m=0.5 * height_m + rng.normal(0, 0.01)))
        length, speed = rng.normal(0.65, 0.05), rng.normal(1.2, 0.15)
        for k in range(steps):
            own_length, own_speed = length + rng.normal(0, 0.01), speed + rng.normal(0, 0.03)
            values = {
                "R_m": own_length / (2 * np.pi) + rng.normal(0, 0.002),
                "r_m": 0.014 + rng.normal(0, 0.002),
                "z0_m": 0.545 * height_m + rng.normal(0, 0.002),
                "omega_rad_s": 10.0 * own_speed + rng.normal(0, 0.2),
                "speed_m_s": own_speed,
                "step_length_m": own_length,
            }
            rows.append(StepRow(name, f"{name}-{k % recordings}", values))
    return people, rows


def pair(result: Population, parameter: str, against: str, group: str = "adults") -> Pair:
    (one,) = [p for p in result.pairs if (p.group, p.parameter, p.against) == (group, parameter, against)]
    return one


def codes(result: Population) -> list[str]:
    return [remark.code for remark in result.remarks]


def test_steps_of_all_recordings_of_a_person_are_pooled() -> None:
    rows = [
        StepRow("a", "one", {"R_m": 0.10, "speed_m_s": 1.0}),
        StepRow("a", "one", {"R_m": 0.12, "speed_m_s": np.nan}),
        StepRow("a", "two", {"R_m": 0.11, "speed_m_s": 1.4}),
        StepRow("b", "three", {"R_m": 0.09, "speed_m_s": 1.0}),
    ]
    a, b = subject_means([Person(name="a", group="g"), Person(name="b", group="g"), Person(name="c", group="g")], rows)
    assert (a.n_steps, a.n_recordings) == (3, 2)
    assert a.mean["R_m"] == pytest.approx(0.11)
    assert a.sd["R_m"] == pytest.approx(0.01)
    assert a.mean["speed_m_s"] == pytest.approx(1.2)
    assert b.mean["R_m"] == 0.09
    assert np.isnan(b.sd["R_m"])


def test_the_laws_of_the_simulated_people_are_recovered() -> None:
    result = study(*lab(40))
    assert {(p.parameter, p.against) for p in result.pairs} == {(p, a) for p in PARAMETERS for a in COVARIATES}
    assert pair(result, "z0_m", "height_m").pearson.r > 0.99
    assert pair(result, "R_m", "step_length_m").pearson.r > 0.95
    assert pair(result, "omega_rad_s", "speed_m_s").pearson.r > 0.95
    through_leg = pair(result, "z0_m", "leg_m")
    assert through_leg.pearson.r > 0.9
    assert abs(through_leg.partial_on["height_m"].r) < 0.5
    nothing = pair(result, "r_m", "height_m")
    assert nothing.pearson.ci95 is not None
    assert nothing.pearson.ci95[0] < 0.0 < nothing.pearson.ci95[1]
    assert nothing.p_holm >= nothing.pearson.p
    assert nothing.pearson.bootstrap_ci95 is not None
    assert set(nothing.partial_on) == {"leg_m", "speed_m_s", "step_length_m"}


def test_the_mixed_models_separate_people_from_steps() -> None:
    result = study(*lab(30, steps=6))
    z0 = result.models["adults", "z0_m"]
    assert z0.effect("height_m").ci95[0] < 0.545 < z0.effect("height_m").ci95[1]
    omega = result.models["adults", "omega_rad_s"]
    assert omega.effect("speed_m_s").ci95[0] < 10.0 < omega.effect("speed_m_s").ci95[1]
    assert result.spreads["adults", "z0_m"].icc > 0.99
    assert result.spreads["adults", "r_m"].icc < 0.2
    assert result.spreads["adults", "r_m"].step_sd == pytest.approx(0.002, rel=0.15)


def test_without_repeats_there_is_no_mixed_model() -> None:
    result = study(*lab(11, steps=1))
    assert result.models == {}
    assert result.spreads == {}
    assert len(result.pairs) == len(PARAMETERS) * len(COVARIATES)


def test_children_and_adults_are_separate_groups_with_a_remark() -> None:
    grown, small = lab(12, seed=1), lab(8, seed=2, group="children", height=1.35)
    result = study([*grown[0], *small[0]], [*grown[1], *small[1]])
    assert {p.group for p in result.pairs} == {"adults", "children"}
    assert pair(result, "R_m", "height_m").pearson.n == 12
    assert pair(result, "R_m", "height_m", "children").pearson.n == 8
    assert codes(result) == ["groups-apart"]
    assert "adults (12), children (8)" in result.remarks[0].message


def test_groups_are_pooled_only_on_request_with_a_remark() -> None:
    grown, small = lab(12, seed=1), lab(8, seed=2, group="children", height=1.35)
    result = study([*grown[0], *small[0]], [*grown[1], *small[1]], pooled=True)
    assert pair(result, "z0_m", "height_m", "all").pearson.n == 20
    assert pair(result, "z0_m", "height_m").pearson.n == 12
    assert codes(result) == ["groups-pooled"]
    assert study(*lab(8), pooled=True).remarks == ()


def test_people_without_height_are_left_out_where_it_is_needed_and_named() -> None:
    people, rows = lab(8)
    people[3] = Person(name=people[3].name, group="adults", leg_m=0.9)
    result = study(people, rows)
    against_height = pair(result, "R_m", "height_m")
    assert against_height.pearson.n == 7
    assert against_height.left_out == (people[3].name,)
    assert pair(result, "R_m", "speed_m_s").pearson.n == 8
    assert pair(result, "R_m", "speed_m_s").partial_on["height_m"].n == 7
    assert codes(result) == ["height-missing"]
    assert people[3].name in result.remarks[0].message
    assert result.models["adults", "R_m"].n_people == 7


@pytest.mark.parametrize("n", [1, 2, 3])
def test_too_few_people_have_means_but_no_correlations(n: int) -> None:
    result = study(*lab(n))
    assert len(result.subjects) == n
    assert result.pairs == ()
    assert codes(result) == ["too-few-subjects"]


def test_a_study_without_people_is_empty() -> None:
    result = study([], [])
    assert result.subjects == ()
    assert result.pairs == ()


def test_four_people_are_enough_for_an_answer_and_too_few_for_some_intervals() -> None:
    result = study(*lab(4))
    one = pair(result, "R_m", "speed_m_s")
    assert one.pearson.ci95 is not None
    assert one.partial_on["step_length_m"].ci95 is None


def test_a_study_without_any_height_correlates_with_speed_and_step_length_only() -> None:
    people, rows = lab(6)
    result = study([Person(name=p.name, group="adults") for p in people], rows)
    assert {p.against for p in result.pairs} == {"speed_m_s", "step_length_m"}
    assert result.models == {}
    assert result.spreads["adults", "R_m"].n_people == 6


def test_a_parameter_that_is_the_same_for_all_has_no_correlation() -> None:
    people, rows = lab(6)
    flat = [StepRow(s.person, s.recording, {**s.values, "r_m": 0.01}) for s in rows]
    assert "r_m" not in {p.parameter for p in study(people, flat).pairs}


def test_the_order_of_the_people_does_not_matter_but_for_the_draws() -> None:
    people, rows = lab(9)
    forth, back = study(people, rows), study(people[::-1], rows[::-1])
    for p in forth.pairs:
        other = pair(back, p.parameter, p.against)
        assert other.pearson.r == pytest.approx(p.pearson.r)
        assert other.p_holm == pytest.approx(p.p_holm)
    for key, model in forth.models.items():
        assert back.models[key].subject_sd == pytest.approx(model.subject_sd, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize(
    ("stated", "age", "height", "expected"),
    [
        ("patients", 30.0, 1.7, ("patients", "stated")),
        (None, 17.9, 1.9, ("children", "age")),
        ("", 18.0, 1.3, ("adults", "age")),
        (None, None, 1.3, ("children", "height")),
        (None, None, 1.58, ("unknown", "unknown")),
        (None, None, None, ("unknown", "unknown")),
    ],
)
def test_a_group_is_what_is_stated_else_by_age_else_by_height(
    stated: str | None, age: float | None, height: float | None, expected: tuple[str, str]
) -> None:
    assert assign_group(stated, age, height) == expected


def test_guessed_groups_are_remarked() -> None:
    people, rows = lab(4)
    guessed = [
        Person(name=p.name, group="children", height_m=1.3 + i / 50, group_source="height")
        for i, p in enumerate(people)
    ]
    assert codes(study(guessed, rows)) == ["group-from-height"]
    unknown = [Person(name=p.name, group="unknown", height_m=p.height_m, group_source="unknown") for p in people]
    assert codes(study(unknown, rows)) == ["group-unknown"]
