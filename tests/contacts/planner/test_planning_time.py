"""The time limit of the contact planner, which is one of processor time, on machines that are busy or slow."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from contacts.planner.test_planner import PLANNER, SHAPES, of_scenario, planned
from stridelab.contacts.planner import milp, planner
from stridelab.contacts.planner.foothold_regions import foothold_regions
from stridelab.contacts.planner.planner import ContactPlan, ContactPlanner
from stridelab.contacts.scenarios.stairs import flat_walk
from stridelab.errors import NotEstimable


class BusyMachine:
    """Clocks of a machine that gives the planner ``share`` of a core, and a solver that needs ``cpu_s`` of it."""

    def __init__(self, share: float, cpu_s: float) -> None:
        self.share, self.cpu_s = share, cpu_s
        self.used_s = self.wall_s = 0.0
        self.solve = milp.milp  # type: ignore[attr-defined]

    def process_time(self) -> float:
        return self.used_s

    def monotonic(self) -> float:
        return self.wall_s

    def milp(self, *arguments: Any, options: dict[str, float], **more: Any) -> Any:
        wall_s = min(options["time_limit"], self.cpu_s / self.share)
        self.wall_s, self.used_s = self.wall_s + wall_s, self.used_s + wall_s * self.share
        if wall_s < self.cpu_s / self.share:
            return SimpleNamespace(x=None, status=milp.LIMIT_REACHED)
        return self.solve(*arguments, **more)


@pytest.mark.parametrize("share", [1.0, 0.5, 0.15])
@pytest.mark.parametrize(("cpu_s", "code"), [(9.0, None), (11.0, "contact-plan-timeout")])
def test_a_busy_machine_gives_the_same_answer(
    monkeypatch: pytest.MonkeyPatch, share: float, cpu_s: float, code: str | None
) -> None:
    """A program of 9 s of processor time fits a budget of 10 s, one of 11 s does not, whatever else is computed."""
    request = of_scenario(flat_walk())
    machine = BusyMachine(share, cpu_s)
    monkeypatch.setattr(milp, "time", machine)
    monkeypatch.setattr(milp, "milp", machine.milp)
    answer = planned(request, ContactPlanner(SHAPES, PLANNER.limits, seconds=10.0))
    if code is None:
        assert isinstance(answer, ContactPlan)
        assert answer.scenario == PLANNER.plan(request).scenario
    else:
        assert isinstance(answer, NotEstimable)
        assert answer.code == code
        assert "10 s of processor time" in answer.message


def test_wall_time_is_limited_as_a_safety(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that gets 2 % of a core would need 450 s of wall time; it ends after about ten times its budget."""
    machine = BusyMachine(0.02, 9.0)
    monkeypatch.setattr(milp, "time", machine)
    monkeypatch.setattr(milp, "milp", machine.milp)
    answer = planned(of_scenario(flat_walk()), ContactPlanner(SHAPES, PLANNER.limits, seconds=10.0))
    assert isinstance(answer, NotEstimable)
    assert answer.code == "contact-plan-timeout"
    assert machine.wall_s <= milp.WALL_PER_CPU_MAX * 10.0


def test_regions_of_further_headings_are_not_computed_beyond_the_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside many obstacles they take most of the time, which no program of the solver would notice."""
    computed: list[float] = []

    def count_regions(*_: object) -> list[Any]:
        computed.append(0.0)
        machine.used_s += 4.0
        return regions(*_)

    machine = BusyMachine(1.0, 0.0)
    regions = foothold_regions
    monkeypatch.setattr(milp, "time", machine)
    monkeypatch.setattr(planner, "foothold_regions", count_regions)
    turned = of_scenario(flat_walk())
    x = turned["goal"]["contacts"][0]["position_m"][0]
    for foot in turned["goal"]["contacts"]:
        y = 0.09 if foot["effector"] == "left_foot" else -0.09
        foot |= {"position_m": [x - y, 0.0, 0.0], "orientation_wxyz": [np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)]}
    answer = planned(turned, ContactPlanner(SHAPES, PLANNER.limits, seconds=10.0))
    assert isinstance(answer, NotEstimable)
    assert answer.code == "contact-plan-timeout"
    assert len(computed) <= 5, "not those of all headings of a walk that turns"
