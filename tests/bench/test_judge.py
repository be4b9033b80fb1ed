"""What a scenario's check costs the API process: every bundled scenario, and one of the contract's largest."""

import json

import pytest

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenarios.stairs import CLIMBING, Stairs, climb
from stridelab.contacts.validation.static_equilibrium import cached_region
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.machine.models_folder import models_dir

BUNDLED = sorted(path.stem for path in (models_dir() / "scenarios").glob("*.json"))


@pytest.mark.parametrize("name", BUNDLED)
def test_a_bundled_scenario(benchmark, name):
    """For the first time: no region is remembered."""
    scenario = json.loads((models_dir() / "scenarios" / f"{name}.json").read_text(encoding="utf-8"))
    shapes = effector_shapes(scenario["robot"])
    benchmark.pedantic(lambda: validate_scenario(scenario, shapes), setup=cached_region.cache_clear, rounds=10)


def test_the_largest(benchmark):
    """A flight of 99 stairs in 397 phases."""
    scenario, shapes = climb(Stairs(99, 0.1), CLIMBING), effector_shapes("talos")
    assert len(scenario["phases"]) == 397
    benchmark.pedantic(lambda: validate_scenario(scenario, shapes), rounds=3)
