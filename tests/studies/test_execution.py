"""What the page on executed scenarios is made of: every case is a valid scenario, boundaries are located."""

from dataclasses import replace

import pytest

from experiments.bundled_scenarios import BUNDLED
from experiments.execution import CASES, Execution
from experiments.robustness import BISECTIONS, fixed_disturbances, scalable_disturbances, survival_boundary
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.wholebody.certificate.certificate import Check
from stridelab.wholebody.replay.disturbances import UNDISTURBED


@pytest.mark.parametrize(("robot", "name"), [(robot, name) for robot, cases in CASES.items() for name in cases])
def test_every_case_is_a_scenario_of_its_robot(robot: str, name: str) -> None:
    sequence = sequence_of(CASES[robot][name](), effector_shapes(robot))
    assert sequence.robot == robot


def test_talos_does_every_bundled_scenario_of_its_own() -> None:
    assert set(CASES["talos"]) == {name for name in BUNDLED if not name.endswith("hrp2")}


def test_an_execution_is_certified_by_all_of_its_checks() -> None:
    good, bad = Check("a", 1.0, "m", 2.0), Check("b", 3.0, "m", 2.0)
    assert Execution("talos", "x", checks=(good,)).is_certified
    assert not Execution("talos", "x", checks=(good, bad)).is_certified
    assert not Execution("talos", "x").is_certified
    assert Execution("talos", "x", checks=(good, bad)).check_value("b") == 3.0


def test_the_boundary_is_bisected() -> None:
    result = survival_boundary(lambda kg: kg < 7.3, 16.0)
    assert result < 7.3 <= result + 16.0 / 2**BISECTIONS
    assert survival_boundary(lambda _: False, 16.0) == 0.0


def test_every_disturbance_disturbs() -> None:
    listed = fixed_disturbances(10.0)
    assert UNDISTURBED not in listed.values()
    assert len({replace(d) for d in listed.values()}) == len(listed)
    for too_much, of_size in scalable_disturbances(10.0).values():
        assert of_size(0.5 * too_much) != of_size(too_much)
