"""The rows that the C++ module fills are those of ``task_stack``, on motions with swings, hands and near pairs."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from stridelab.centroidal.native.availability import NativeSolver, native_availability
from stridelab.centroidal.rest_to_rest import from_rest_to_rest
from stridelab.centroidal.solver import solve
from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.scenario_io import sequence_of
from stridelab.contacts.swing import SwingCurve, SwingPoint
from stridelab.reachability.store import load_proxies
from stridelab.robots.loader import load_robot
from stridelab.service.samples.scenarios import bundled_scenarios
from stridelab.wholebody.control.collision_avoidance import CollisionAvoidance
from stridelab.wholebody.control.controller import WholeBodyController
from stridelab.wholebody.control.hierarchical_qp import Inequalities, Rows
from stridelab.wholebody.control.task_stack import PhaseHierarchy, SampleTargets

AllRows = tuple[Rows, list[Rows], Inequalities]
SOLE, HAND = True, False
EVERY = 7
"""Only every so many samples are compared."""

pytestmark = pytest.mark.skipif(not isinstance(native_availability(), NativeSolver), reason="the module is not built")


@dataclass
class Comparison:
    """Compares the rows of both ways at every ``EVERY``-th sample of a run."""

    differences: list[float] = field(default_factory=list)
    avoided: int = 0
    swings: set[bool] = field(default_factory=set)

    def build(self, phase: PhaseHierarchy, instant: SampleTargets) -> AllRows:
        """``PhaseHierarchy.build_rows`` by the module."""
        targets: dict[str, SwingPoint] = {}
        advance = PhaseHierarchy._swing_target

        def once(name: str, curve: SwingCurve, time_s: float) -> SwingPoint:
            """The detour of a swing advances once per sample."""
            if name not in targets:
                targets[name] = advance(phase, name, curve, time_s)
            return targets[name]

        native = phase._native_rows
        phase.__dict__["_swing_target"] = once
        rows = BUILD(phase, instant)
        if len(self.differences) * EVERY <= round(250.0 * instant.time_s):
            copied = [array.copy() for array in flat(rows)]
            phase.__dict__["_native_rows"] = None
            with pytest.MonkeyPatch.context() as patch:  # nearest points may not be unique
                patch.setattr(CollisionAvoidance, "update", lambda _self, _body: None)
                expected = flat(BUILD(phase, instant))
            phase.__dict__["_native_rows"] = native
            assert [a.shape for a in copied] == [a.shape for a in expected]
            self.differences.append(max(relative(a, b) for a, b in zip(copied, expected, strict=True)))
            self.avoided += len(phase._avoidance.task_rows()[1]) if phase._avoidance is not None else 0
            self.swings |= {phase._surface[name] for name in phase._swings}
            for array, value in zip(flat(rows), copied, strict=True):  # both ways fill the same bounds
                array[...] = value
        return rows


BUILD = PhaseHierarchy.build_rows


def flat(rows: AllRows) -> list[np.ndarray]:
    equality, levels, bounds = rows
    return [*equality, *(array for level in levels for array in level), *bounds]


def relative(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference over the largest number of each row; infinite numbers have to be the same."""
    finite = np.isfinite(b)
    assert np.array_equal(finite, np.isfinite(a))
    a, b = np.where(finite, a, 0.0), np.where(finite, b, 0.0)
    size = np.maximum(np.abs(b).max(axis=-1, keepdims=True), 1.0)
    return float((np.abs(a - b) / size).max(initial=0.0))


@pytest.mark.parametrize(
    ("name", "swinging"), [("wall-step", {SOLE}), ("stairs-with-rail-hrp2", {HAND, SOLE}), ("six-stairs", {SOLE})]
)
def test_the_rows_of_a_motion_are_the_same(name: str, swinging: set[bool], monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = bundled_scenarios()[name]
    robot, comparison = load_robot(scenario["robot"]), Comparison()
    sequence = sequence_of(scenario, effector_shapes(robot.name))
    plan = solve(from_rest_to_rest(robot, sequence, load_proxies(robot.name)))
    monkeypatch.setattr(PhaseHierarchy, "build_rows", lambda phase, instant: comparison.build(phase, instant))
    WholeBodyController(rate_hz=100.0).run(robot, plan.sequence, plan)
    assert len(comparison.differences) > 50
    assert max(comparison.differences) < 1e-12
    assert comparison.avoided > 0
    assert comparison.swings == swinging
