"""Contact sequences leave for other tools and come back; what cannot be read names its phase and effector."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from experiments.bundled_scenarios import BUNDLED
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.multicontact_api import from_multicontact, to_multicontact
from stridelab.contacts.scenario_io import scenario_of, sequence_of
from stridelab.contacts.scenarios.stairs import stairs_with_rail
from stridelab.errors import InvalidInput
from stridelab.schemas.scenarios import Scenario
from support.robots.scenario_bodies import SHAPES

Document = dict[str, Any]


def document() -> Document:
    return to_multicontact(sequence_of(stairs_with_rail(), SHAPES), "about it")


@pytest.mark.parametrize("name", BUNDLED)
def test_there_and_back(name: str) -> None:
    shapes = effector_shapes(BUNDLED[name]()["robot"])
    sequence = sequence_of(BUNDLED[name](), shapes)
    text = json.dumps(to_multicontact(sequence, "about it"), allow_nan=False)
    read = from_multicontact(json.loads(text))
    back = Scenario.model_validate(read).model_dump(mode="json")
    was, now = scenario_of(sequence, "about it"), scenario_of(sequence_of(back, shapes), "about it")
    assert (back["name"], back["description"], back["robot"]) == (was["name"], "about it", was["robot"])
    assert read["terrain"] == was["terrain"]
    assert (now["friction"], now.get("start_com_height_m")) == (was["friction"], was.get("start_com_height_m"))
    assert [p["duration_s"] for p in now["phases"]] == pytest.approx([p["duration_s"] for p in was["phases"]])
    for one, other in zip(was["phases"], now["phases"], strict=True):
        assert [c["effector"] for c in one["contacts"]] == [c["effector"] for c in other["contacts"]]
        for a, b in zip(one["contacts"], other["contacts"], strict=True):
            assert a["position_m"] == b["position_m"]
            np.testing.assert_allclose(a["orientation_wxyz"], b["orientation_wxyz"], atol=1e-9)


def test_the_fields_are_those_of_multicontact_api() -> None:
    first, second = document()["contact_phases"][:2]
    assert (first["t_init"], first["t_final"], second["t_init"]) == (0.0, 1.9, 1.9)
    assert second["t_final"] == pytest.approx(3.7)
    assert (
        set(first["effector_in_contact"]) == {"left_foot", "right_foot", "right_hand"} == set(first["contact_patches"])
    )
    foot, hand = (first["contact_patches"][name] for name in ("left_foot", "right_hand"))
    assert foot["placement"]["translation"] == [-0.3, 0.09, 0.0]
    model = foot["contact_model"]
    assert (model["mu"], model["contact_type"], model["num_contact_points"]) == (0.3, "CONTACT_PLANAR", 4)
    corners = np.array(model["contact_points_positions"])
    assert corners.shape == (3, 4)
    assert {(round(x, 9), round(y, 9)) for x, y, _ in corners.T} == {
        (0.1, 0.06),
        (-0.1, 0.06),
        (-0.1, -0.06),
        (0.1, -0.06),
    }
    assert (hand["contact_model"]["contact_type"], hand["contact_model"]["mu"]) == ("CONTACT_POINT", 0.6)
    np.testing.assert_allclose(np.array(hand["placement"]["rotation"]) @ [0, 0, 1], [-np.sqrt(0.2), 0, np.sqrt(0.8)])


def test_what_other_tools_do_not_say_is_given_beside() -> None:
    bare = {"contact_phases": document()["contact_phases"]}
    for phase in bare["contact_phases"]:
        phase["t_init"], phase["t_final"] = phase["t_init"] + 7.0, phase["t_final"] + 7.0
        del phase["effector_in_contact"]
    with pytest.raises(InvalidInput, match="robot") as caught:
        from_multicontact(bare)
    assert [fault.where for fault in caught.value.faults] == ["robot", "terrain"]
    known = stairs_with_rail()
    scenario = from_multicontact(bare, {key: known[key] for key in ("robot", "terrain", "friction")})
    assert scenario["name"] == "Imported"
    assert sequence_of(scenario, SHAPES).duration_s == pytest.approx(36.4)


def second(change: Document) -> Callable[[Document], None]:
    return lambda made: made["contact_phases"][2].update(change)


def patch(effector: str, change: Document) -> Callable[[Document], None]:
    return lambda made: made["contact_phases"][2]["contact_patches"][effector]["placement"].update(change)


@pytest.mark.parametrize(
    ("change", "where", "word"),
    [
        (second({"t_init": 3.0}), "phases[2]", "overlaps phase 1"),
        (second({"t_init": 3.9}), "phases[2]", "gap of 0.2 s after phase 1"),
        (second({"t_init": 4.2, "t_final": 3.7}), "phases[2]", "not after its start"),
        (second({"t_init": math.nan}), "phases[2]", "finite"),
        (second({"t_final": "late"}), "phases[2]", "numbers"),
        (second({"effector_in_contact": ["left_foot", "left_foot"]}), "phases[2].contacts[left_foot]", "twice"),
        (second({"effector_in_contact": ["tail"]}), "phases[2].contacts[tail]", "no patch"),
        (patch("left_foot", {"translation": [0.0, math.nan, 0.0]}), "phases[2].contacts[left_foot]", "finite"),
        (patch("left_foot", {"translation": ["here", 0.0, 0.0]}), "phases[2].contacts[left_foot]", "'here'"),
        (patch("left_foot", {"translation": [0.0, 0.0]}), "phases[2].contacts[left_foot]", "three"),
        (
            patch("right_hand", {"rotation": [[1, 0, 0], [0, 2, 0], [0, 0, 1]]}),
            "phases[2].contacts[right_hand]",
            "matrix",
        ),
        (
            patch("right_hand", {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}),
            "phases[2].contacts[right_hand]",
            "matrix",
        ),
        (patch("right_hand", {"rotation": "none"}), "phases[2].contacts[right_hand]", ""),
    ],
)
def test_what_cannot_be_read(change: Callable[[Document], None], where: str, word: str) -> None:
    made = document()
    change(made)
    with pytest.raises(InvalidInput) as caught:
        from_multicontact(made)
    assert caught.value.code == "contact-sequence-invalid"
    assert caught.value.faults[0].where == where
    reported = caught.value.faults[0].message
    assert word in reported
    assert reported[0].islower()  # the message of the whole puts the place before it


@pytest.mark.parametrize("made", [{}, {"contact_phases": []}, {"contact_phases": "none"}, {"contact_phases": [3]}])
def test_things_that_are_no_contact_sequence(made: Document) -> None:
    with pytest.raises(InvalidInput) as caught:
        from_multicontact(made)
    assert caught.value.code == "contact-sequence-invalid"
