"""What a session says follows from the facts of its trials: who counts, how often, and in no particular order."""

import math
from itertools import permutations
from typing import Any

import pytest

from stridelab.estimation.random_effects import pool_measurements
from stridelab.pipelines.session_values import (
    MASS_REPEATABILITY_SHARE,
    PLATE_WEIGHT_SD_SHARE,
    UNKNOWN_ZERO_SD_KG,
    TrialFacts,
    select_static_trial,
    session_values,
)
from stridelab.recordings.body_mass import UNCHECKED_ZERO_SD_KG
from stridelab.schemas.recordings import TrialClock
from support.service.stored_rows import CORNERS_M, facts


def trial(name: str, latency_ms: float | None = 17.0, sd_ms: float = 1.0, **changes: Any) -> TrialFacts:
    clock = None if latency_ms is None else TrialClock(latency_s=latency_ms / 1e3, sd_s=sd_ms / 1e3)
    known = {"clock": clock, "mass_from_force_kg": 60.0, "mass_from_force_sd_kg": 0.6}
    return TrialFacts(name, f"{name}.c3d", changes.pop("sha256", name), facts(**{**known, **changes}))


def test_latency_and_mass_are_pooled_over_all_trials_of_the_session() -> None:
    own, others = trial("a", 38.6, 7.7), [trial("b", 17.3, 1.3), trial("c", 17.5, 0.9, mass_from_force_kg=61.0)]
    values = session_values("s", own, others)
    assert values is not None
    expected = pool_measurements([0.0386, 0.0173, 0.0175], [0.0077, 0.0013, 0.0009])
    assert values.latency_s == pytest.approx(expected.mean, rel=1e-12)
    assert values.latency_sd_s == pytest.approx(expected.sd, rel=1e-12)
    assert values.latency_n_trials == values.mass_n_trials == 3
    masses_kg = [60.0, 60.0, 61.0]
    sds_kg = [math.hypot(0.6, MASS_REPEATABILITY_SHARE * mass_kg) for mass_kg in masses_kg]
    weighed = pool_measurements(masses_kg, sds_kg, scaled=True)
    assert values.mass_kg == pytest.approx(weighed.mean)
    assert values.mass_sd_kg == pytest.approx(math.hypot(weighed.sd, PLATE_WEIGHT_SD_SHARE * weighed.mean))
    assert [one.recording_id for one in values.trials] == ["a", "b", "c"]
    assert sum(one.latency_weight or 0.0 for one in values.trials) == pytest.approx(1.0)
    assert values.trials[0].latency_weight == pytest.approx(expected.weights[0])


def heavy(name: str, mass_kg: float, sd_kg: float, **changes: Any) -> TrialFacts:
    return trial(name, mass_from_force_kg=mass_kg, mass_from_force_sd_kg=sd_kg, **changes)


def test_landings_that_weigh_too_much_do_not_move_the_mass_of_the_walks() -> None:
    walks = [heavy(name, mass_kg, 0.4) for name, mass_kg in (("a", 59.2), ("b", 59.2), ("c", 59.5))]
    landings = [heavy(name, 65.0 + k, 4.0) for k, name in enumerate("defgh")]
    values = session_values("s", walks[0], [*walks[1:], *landings])
    assert values is not None
    assert values.mass_kg == pytest.approx(59.4, abs=0.2)
    assert values.trials[0].mass_sd_kg == 0.4


def test_trials_whose_plates_hide_their_zero_count_as_one() -> None:
    """Their zero is wrong by the same 3 kg: five of them do not outvote three that show it."""
    hidden = {"plates": [{"index": 1, "type": 2, "corners_m": CORNERS_M, "loaded_s": [(0.0, 1.0)]}]}
    shown = {"plates": [{"index": 1, "type": 2, "corners_m": CORNERS_M, "loaded_s": [(0.2, 0.8)]}]}
    walks = [heavy(name, 63.7, 0.3, **shown) for name in "abc"]
    squats = [heavy(name, 60.7, 1.0, **hidden) for name in "defgh"]
    values = session_values("s", walks[0], [*walks[1:], *squats])
    assert values is not None
    assert values.mass_kg == pytest.approx(63.7, abs=0.3)
    of_squats = [one.mass_weight or 0.0 for one in values.trials[3:]]
    assert sum(of_squats) < max(one.mass_weight or 0.0 for one in values.trials[:3])
    assert UNKNOWN_ZERO_SD_KG == UNCHECKED_ZERO_SD_KG


def test_every_trial_of_a_session_gets_the_same_values_in_whatever_order_they_came() -> None:
    trials = [trial("a", 17.0), trial("b", 19.0, 1.7), trial("c", 30.0, 4.8), trial("d", None)]
    result = {
        session_values("s", order[0], order[1:]).model_dump_json()  # type: ignore[union-attr]
        for order in permutations(trials)
    }
    assert len(result) == 1


def test_a_trial_alone_has_no_session() -> None:
    assert session_values("s", trial("a"), []) is None
    twin = trial("b", 25.0, sha256="a")
    assert session_values("s", trial("a"), [twin]) is None, "the same bytes are the same trial"
    silent = trial("c", None, mass_from_force_kg=None)
    assert session_values("s", trial("a"), [silent]) is None


def test_a_trial_without_a_clock_of_its_own_takes_that_of_the_others() -> None:
    values = session_values("s", trial("a", None), [trial("b", 12.0, 1.0)])
    assert values is not None
    assert (values.latency_s, values.latency_sd_s, values.latency_n_trials) == (pytest.approx(0.012), 0.001, 1)


@pytest.mark.parametrize(
    "changes",
    [
        {"force_rate_hz": 2000.0},
        {"marker_rate_hz": 200.0},
        {"plates": []},
        {"plates": [{"index": 1, "type": 2, "corners_m": [[x + 0.01, y, z] for x, y, z in CORNERS_M], "loaded_s": []}]},
    ],
)
def test_other_plates_or_rates_are_another_clock(changes: dict[str, Any]) -> None:
    assert session_values("s", trial("a"), [trial("b", 25.0, **changes)]) is None
    values = session_values("s", trial("a"), [trial("b", 25.0, **changes), trial("c", 18.0)])
    assert values is not None
    assert [one.recording_id for one in values.trials] == ["a", "c"]


def plates(*zeros: list[float] | None, kind: int = 2) -> list[dict[str, Any]]:
    """Plates 1, 2, ... that read these wrenches unloaded, or are never unloaded."""
    common = {"type": kind, "corners_m": CORNERS_M, "loaded_s": [(0.2, 0.8)]}
    return [{"index": i, "zero": zero, **common} for i, zero in enumerate(zeros, start=1)]


def test_the_zero_of_a_plate_is_the_median_over_the_other_trials() -> None:
    own = trial("a", plates=plates(None, [9.0] * 6))
    others = [trial(name, plates=plates([z] * 6, [1.0] * 6)) for name, z in (("b", 3.0), ("c", 4.0), ("d", 11.0))]
    values = session_values("s", own, others)
    assert values is not None
    assert values.plate_zeros == {1: [4.0] * 6}, "plate 2 has its own"
    turned = [trial(one.recording_id, plates=one.facts.plates, up_axis="-y") for one in others]
    assert session_values("s", own, turned).plate_zeros == {}  # type: ignore[union-attr]


def test_a_plate_that_is_cut_off_below_a_threshold_hides_its_zero() -> None:
    values = session_values("s", trial("a", plates=plates(None)), [trial("b", plates=plates([0.0] * 6))])
    assert values is not None
    assert values.plate_zeros == {}


def test_the_contacts_of_a_force_file_have_no_zero() -> None:
    others = [trial("b", plates=plates([3.0] * 6, kind=0))]
    values = session_values("s", trial("a", plates=plates(None, kind=0)), others)
    assert values is not None
    assert values.plate_zeros == {}


def test_a_zero_alone_makes_a_session() -> None:
    silent = {"mass_from_force_kg": None, "mass_from_force_sd_kg": None}
    values = session_values(
        "s", trial("a", None, plates=plates(None)), [trial("b", None, plates=plates([2.0] * 6), **silent)]
    )
    assert values is not None
    assert (values.plate_zeros, values.latency_s) == ({1: [2.0] * 6}, None)


def test_contacts_of_a_mot_file_are_the_same_plates_wherever_the_feet_stood() -> None:
    def contacts(offset_m: float) -> list[dict[str, Any]]:
        corners = [[x + offset_m, y, z] for x, y, z in CORNERS_M]
        return [{"index": 1, "type": 0, "corners_m": corners, "loaded_s": []}]

    values = session_values("s", trial("a", plates=contacts(0.0)), [trial("b", 18.0, plates=contacts(0.07))])
    assert values is not None
    assert values.latency_n_trials == 2


def test_the_static_trial_is_the_one_that_marks_most() -> None:
    few = trial("a", still=True)
    many = trial("b", still=True, landmarks={"l_asis": "LASI", "r_asis": "RASI", "l_knee_medial": "LKNM"})
    walk = trial("c", landmarks=dict.fromkeys(("l_asis", "r_asis", "c7", "sacrum"), "X"))
    own = trial("d")
    assert all(select_static_trial(own, order) == many for order in permutations([few, many, walk]))
    assert select_static_trial(own, [walk]) is None
    assert select_static_trial(many, [trial("e", still=True, sha256="b")]) is None, "not itself"
