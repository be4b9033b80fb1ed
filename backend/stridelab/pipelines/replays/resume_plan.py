"""Resumes a plan after a recovery: steps from where the robot stands to contacts of the plan, then its other contacts.

Where the soles stand is measured. The contact planner leads them to the nearest stance on both soles among those of the
plan that are still ahead; from there on, the phases are those of the plan. The centre of mass, the whole body and its
certificate are planned anew as for any scenario.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stridelab.contacts.effector_geometry import effector_shapes
from stridelab.contacts.planner.planner import ContactPlanner
from stridelab.contacts.scenario_io import scenario_of
from stridelab.contacts.sequence import ContactSequence
from stridelab.errors import StridelabError
from stridelab.reachability.planner_limits import planner_limits
from stridelab.schemas.scenarios import Scenario
from stridelab.wholebody.motion import WholeBodyMotion
from stridelab.wholebody.recovery.footholds import Footholds
from stridelab.wholebody.replay.resumption import NotResumed, Resumption
from stridelab.wholebody.replay.sensors import SensedState

Plan = Callable[[Scenario], WholeBodyMotion]
"""Plans the motion of a scenario to its end, or raises a ``StridelabError``."""
MAX_TRIES: Final = 3
"""Stances of the plan that are tried, the nearest first, and the last one."""
REACH_S: Final = 1.5
"""Time on both soles before hands touch again."""
PLANNING_S: Final = 10.0
"""Processor time of the contact planner."""


@dataclass(frozen=True, eq=False)
class PlanResumer:
    """Resumes the plan of ``sequence`` with motions of ``plan``; calls are ``resumption.Resume``.

    No certificate is required of the motions.
    """

    sequence: ContactSequence
    plan: Plan

    def __call__(self, left_s: float, measured: SensedState) -> Resumption | NotResumed:
        """A motion to the end of the plan, which was left at ``left_s``, from the measured stance."""
        soles = [name for name, shape in effector_shapes(self.sequence.robot).items() if shape.kind == "surface"]
        start = self._standing_contacts(soles, measured)
        if start is None:
            return NotResumed("the soles do not stand on level surfaces")
        reason = "no stance on both soles is ahead"
        for phase in self._stances_ahead(soles, left_s, measured):
            try:
                return self._resume_at(phase, soles, start, measured)
            except StridelabError as error:
                reason = error.message.rstrip(".")
        return NotResumed(reason)

    def _standing_contacts(self, soles: list[str], measured: SensedState) -> list[dict[str, Any]] | None:
        """The soles where they stand, level at the height of the ground; None where one of them does not."""
        footholds, contacts = Footholds(self.sequence.terrain), []
        for name in soles:
            at = measured.contacts[name]
            ground_m = float(footholds.ground_heights_m(at.position_m[:2]))
            if not math.isfinite(ground_m) or abs(at.position_m[2] - ground_m) > 0.01:
                return None
            yaw_rad = math.atan2(at.rotation[1, 0], at.rotation[0, 0])
            position_m = [*at.position_m[:2].tolist(), ground_m]
            wxyz = [math.cos(0.5 * yaw_rad), 0.0, 0.0, math.sin(0.5 * yaw_rad)]
            contacts.append({"effector": name, "position_m": position_m, "orientation_wxyz": wxyz})
        return contacts

    def _stances_ahead(self, soles: list[str], left_s: float, measured: SensedState) -> Iterator[int]:
        """Phases on all soles from the one that was left on, the nearest first, and the last one at the end."""
        phases = self.sequence.phases
        ahead = [
            k for k in range(self.sequence.phase_at(left_s), len(phases)) if all(n in phases[k].contacts for n in soles)
        ]

        def distance_m(k: int) -> float:
            places = ((phases[k].contacts[name].placement, measured.contacts[name]) for name in soles)
            return sum(float(np.linalg.norm(one.position_m - other.position_m)) for one, other in places)

        yield from dict.fromkeys([*sorted(ahead, key=distance_m)[:MAX_TRIES], *ahead[-1:]])

    def _resume_at(
        self, phase: int, soles: list[str], start: list[dict[str, Any]], measured: SensedState
    ) -> Resumption:
        plan = scenario_of(self.sequence)
        goal = [one for one in plan["phases"][phase]["contacts"] if one["effector"] in soles]
        planner = ContactPlanner(
            effector_shapes(self.sequence.robot), planner_limits(self.sequence.robot), seconds=PLANNING_S
        )
        ends = {"start": {"contacts": start}, "goal": {"contacts": goal}}
        steps = list(planner.plan({**_without_phases(plan), **ends}).scenario["phases"])
        rest = plan["phases"][phase:]
        if len(rest[0]["contacts"]) > len(goal):
            steps.append({"duration_s": REACH_S, "contacts": goal})
        heights_m = [one["position_m"][2] for one in start]
        scenario = Scenario.model_validate(
            {
                **plan,
                "name": f"{self.sequence.name}, resumed"[:100],
                "start_com_height_m": float(measured.com_m[2] - np.mean(heights_m)),
                "phases": [*steps, *rest],
            }
        )
        own_join_s = float(sum(one["duration_s"] for one in steps))
        return Resumption(self.plan(scenario), own_join_s, float(self.sequence.starts_s[phase]))


def _without_phases(plan: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in plan.items() if name not in ("phases", "description", "start_com_height_m")}
