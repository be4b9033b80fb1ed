"""The contact planner: plans a valid scenario from a start stance to a goal stance over a terrain.

The number of steps starts at the minimum for the robot's own step length and increases by one until the program of that
many steps (``milp.StepProgram``) has a solution. Steps as short as those of a walk are tried first, then all that the
limits allow. Where obstacles leave no way ahead, the robot turns aside and passes sideways. If none has a solution, the
error names the gap that is too wide, or the step that misses its limits and by how much. This does not prove
infeasibility: regions are slightly smaller than the validation allows (``foothold_regions``), and at most
``extra_steps`` steps above the minimum are tried.
"""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from stridelab.contacts.effector_geometry import EffectorShape
from stridelab.contacts.planner.foothold_regions import Region, foothold_regions
from stridelab.contacts.planner.milp import PlacedSchedule, PlanningBudget, StepProgram
from stridelab.contacts.planner.obstacles import Obstacle, obstacles_met
from stridelab.contacts.planner.pruning import fewest_moves, first_gap, prune_schedule
from stridelab.contacts.planner.schedule import (
    SAME_M,
    TURN_MAX_RAD,
    RegionLookup,
    Schedule,
    StartAndGoal,
    Transition,
    build_schedule,
)
from stridelab.contacts.planner.start_goal import scenario_without_phases, task_ends
from stridelab.contacts.planner.step_limits import RobotLimits, heading_frame
from stridelab.contacts.swing import LEVEL_M
from stridelab.contacts.validation.parse import DURATION_S, Draft
from stridelab.contacts.validation.surface_contact import contacts_on_surfaces
from stridelab.contacts.validation.validate import validate_scenario
from stridelab.conventions import Progress
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault, NotEstimable

STEPS_MAX: Final = 60
"""Longest plan, in steps."""
ASIDE_RAD: Final = (0.0, math.pi / 2, -math.pi / 2)
"""Turns of the heading in the middle of the walk that are tried, in this order: ahead, then sideways past obstacles."""
MISS_S: Final = 1.0
"""Least processor time for the search of the step that misses its limits."""
EASY_SHARE: Final = 0.05
"""Share of the processor time in which a plan of easy steps is searched first."""
LEVEL_MOVE_SHARE: Final = 0.7
"""Duration of a level step relative to a step to another height."""

RegionCache = dict[tuple[tuple[str, ...], str, int], tuple[Region, ...]]
"""Regions by the names of the obstacles around which they lie, the effector and its heading in microradians."""


@dataclass(frozen=True, eq=False)
class ContactPlan:
    """A planned scenario with its number of steps, the number of programs solved and the objective (m)."""

    scenario: dict[str, Any]
    steps: int
    programs: int
    objective_m: float
    solve_time_s: float


@dataclass(frozen=True)
class ContactPlanner:
    """Contact planner of one robot, given its effectors and its limits; ``seconds`` limits its processor time.

    ``region_cache`` holds the foothold regions of one terrain, for its attempts with easy steps and with all, ahead and
    aside; without it each attempt computes its own.
    """

    effectors: Mapping[str, EffectorShape]
    limits: RobotLimits
    seconds: float = 60.0
    extra_steps: int = 6
    region_cache: RegionCache | None = None

    def plan(
        self,
        task: Mapping[str, Any],
        report_progress: Progress = lambda _share, _message: None,
        forbidden: Sequence[Transition] = (),
    ) -> ContactPlan:
        """Plan ``{robot, terrain, start, goal, friction?, name?}``, fields as in a scenario and its phases.

        ``report_progress`` is called with the progress. No step goes as far as a ``forbidden`` transition.

        Raises ``InvalidInput`` (``stance-invalid``) for an invalid start or goal, naming the contact, and
        ``NotEstimable``: ``contacts-unreachable`` (no sequence of steps; names the gap or the step and by how much it
        misses), ``contacts-too-far`` (more than 60 steps), ``contact-plan-timeout``.
        """
        began = time.process_time()
        budget = PlanningBudget(self.seconds)
        stances = task_ends(task, self.effectors)
        ends = StartAndGoal.from_stances(stances.start, stances.goal, self.limits.feet)
        ends = replace(ends, forbidden=tuple(forbidden))
        same_regions = replace(self, region_cache={})
        try:
            easy = replace(same_regions, limits=replace(self.limits, is_easy=True))
            most = PlanningBudget(EASY_SHARE * self.seconds)
            plan = easy.plan_ahead_or_aside(task, stances.draft, ends, most, report_progress)
        except NotEstimable:
            plan = same_regions.plan_ahead_or_aside(task, stances.draft, ends, budget, report_progress)
        return replace(plan, solve_time_s=time.process_time() - began)

    def plan_ahead_or_aside(
        self,
        task: Mapping[str, Any],
        draft: Draft,
        ends: StartAndGoal,
        budget: PlanningBudget,
        report_progress: Progress,
    ) -> ContactPlan:
        """Plan a draft ahead, else sideways past the obstacles, with the limits of this planner within ``budget``.

        Raises ``NotEstimable`` as ``plan``, with the reason for which there is no plan ahead.
        """
        errors: list[NotEstimable] = []
        for aside_rad in ASIDE_RAD:
            ends = replace(ends, aside_rad=aside_rad)
            try:
                while True:
                    plan, met = self._plan_around(task, draft, ends, budget, report_progress)
                    if not met:
                        return plan
                    ends = replace(ends, obstacles=ends.obstacles + met)
            except NotEstimable as error:
                errors.append(error)
                if error.code != "contacts-unreachable" or not ends.obstacles:
                    break
        raise errors[0]

    def _plan_around(
        self,
        task: Mapping[str, Any],
        draft: Draft,
        ends: StartAndGoal,
        budget: PlanningBudget,
        report_progress: Progress,
    ) -> tuple[ContactPlan, tuple[Obstacle, ...]]:
        """Plan around obstacles and transitions; return the plan and the further obstacles that it meets."""
        rooms, least = self._prepare_rooms(draft, ends, budget)
        if least > STEPS_MAX:
            message = f"The goal is at least {least} steps away; a plan has at most {STEPS_MAX} steps."
            raise NotEstimable("contacts-too-far", message, [Fault("goal", f"{least} steps away")])
        self._raise_for_gap(ends, draft, rooms)
        steps = min(STEPS_MAX, max(2, least) + self.extra_steps)
        for k, plan in enumerate(self._candidate_schedules(ends, rooms, least)):
            report_progress(min(0.9, k / (2 * self.extra_steps + 2)), f"{len(plan.feet) - 1} steps")
            program = StepProgram(plan, self.limits, ends)
            if budget.is_spent:
                raise _timeout_error(self.seconds)
            answer = program.solve(budget)
            if answer.x is not None:
                placed = program.placements_of(answer)
                if met := self._further_obstacles(draft, plan, placed, ends.obstacles):
                    return ContactPlan({}, len(plan.feet) - 1, k + 1, answer.objective, 0.0), met
                scenario = self._validated_scenario(task, draft, plan, placed)
                return ContactPlan(scenario, len(plan.feet) - 1, k + 1, answer.objective, 0.0), ()
            if not answer.proven:
                raise _timeout_error(self.seconds)
            steps = len(plan.feet) - 1
        raise self._unreachable_error(ends, rooms, steps, budget)

    def prepare_task(self, task: Mapping[str, Any]) -> tuple[StartAndGoal, RegionLookup, int]:
        """Return ends, foothold regions and the minimum number of steps. Raises ``InvalidInput`` as ``plan``."""
        stances = task_ends(task, self.effectors)
        ends = StartAndGoal.from_stances(stances.start, stances.goal, self.limits.feet)
        return ends, *self._prepare_rooms(stances.draft, ends, PlanningBudget(self.seconds))

    def _prepare_rooms(self, draft: Draft, ends: StartAndGoal, budget: PlanningBudget) -> tuple[RegionLookup, int]:
        rooms = self._region_lookup(draft, ends.obstacles, budget)
        least = _least_steps(ends, self.limits)
        return rooms, least and max(least, fewest_moves(ends, self.limits, rooms))

    def _further_obstacles(
        self, draft: Draft, plan: Schedule, placed: PlacedSchedule, known: tuple[Obstacle, ...]
    ) -> tuple[Obstacle, ...]:
        """Obstacles in the way of a plan that are not among the known ones."""
        if len(plan.feet) < 2:
            return ()
        walk = [(plan.nodes[i], placed.placements[i]) for i in plan.walk]
        feet = [(node.effector, at) for node, at in walk if at is not None]
        names = {obstacle.name for obstacle in known}
        others = [surface for surface in draft.terrain.surfaces if surface.name not in names]
        return tuple(obstacles_met(others, feet, [node.yaw_rad for node, _ in walk], self.limits))

    def _candidate_schedules(self, ends: StartAndGoal, regions_at: RegionLookup, min_steps: int) -> Iterator[Schedule]:
        """Yield the schedules that may have a solution, fewest steps first."""
        right = self.limits.defaults.first_foot
        order = (right, *(foot for foot in self.limits.feet if foot != right))
        last = STEPS_MAX
        for steps in range(min_steps, STEPS_MAX + 1):
            if steps > last:
                return
            for first in order:
                plan = build_schedule(ends, self.limits, regions_at, steps, first)
                candidate = None if plan is None else prune_schedule(plan, self.limits)
                if candidate is not None:
                    last = min(last, steps + self.extra_steps)
                    yield candidate

    def _region_lookup(self, draft: Draft, obstacles: tuple[Obstacle, ...], budget: PlanningBudget) -> RegionLookup:
        """Cached lookup of the regions of an effector at a heading, rounded to a microradian.

        Beside many obstacles a heading takes a tenth of a second, and each number of steps has headings of its own. The
        lookup raises ``contact-plan-timeout`` if ``budget`` is spent.
        """
        cache: RegionCache = {} if self.region_cache is None else self.region_cache
        names = tuple(obstacle.name for obstacle in obstacles)
        gap_m = self.limits.defaults.toe_gap_m

        def regions_at(effector: str, yaw_rad: float) -> tuple[Region, ...]:
            key = (names, effector, round(yaw_rad * 1e6))
            if key not in cache:
                if budget.is_spent:
                    raise _timeout_error(self.seconds)
                shape = self.limits.effectors[effector]
                regions = foothold_regions(draft.terrain, draft.friction, shape, yaw_rad, gap_m, obstacles)
                cache[key] = tuple(regions)
            return cache[key]

        return regions_at

    def _validated_scenario(
        self, task: Mapping[str, Any], draft: Draft, plan: Schedule, placed: PlacedSchedule
    ) -> dict[str, Any]:
        """Return the scenario. Raises ``NotEstimable`` (``contact-plan-refused``) if it fails validation."""
        scenario = {
            **scenario_without_phases(task),
            "friction": draft.friction,
            "phases": _scenario_phases(plan, placed, self.limits),
        }
        report = validate_scenario(scenario, self.effectors)
        if not report.valid:
            first = report.faults[0]
            message = f"The planned contact sequence fails validation: {first.where}: {first.message}."
            raise NotEstimable("contact-plan-refused", message, report.faults)
        return scenario

    def _raise_for_gap(self, ends: StartAndGoal, draft: Draft, regions_at: RegionLookup) -> None:
        """Raise ``contacts-unreachable`` if no number of steps crosses a gap."""
        start, goal = contacts_on_surfaces(draft, self.effectors)
        names = {foot: (start[foot].surface or "", goal[foot].surface or "") for foot in self.limits.feet}
        gap = first_gap(ends, self.limits, regions_at, names)
        if gap is not None and ends.obstacles:  # without them there is a way
            raise _no_way_round(gap.obstacles or [obstacle.name for obstacle in ends.obstacles])
        if gap is not None:
            missing = _gap_text(gap.missing_m)
            text = f"the step from {gap.from_surface!r} to {gap.to_surface!r} would have to reach {missing}"
            message = f"There is no way to the goal: after {gap.step} steps or more, {text}."
            raise NotEstimable("contacts-unreachable", message, [Fault(f"terrain[{gap.to_surface}]", text)])

    def _unreachable_error(
        self, ends: StartAndGoal, regions_at: RegionLookup, steps: int, budget: PlanningBudget
    ) -> NotEstimable:
        """The error that names the worst step of the plan with the least total violation of its limits."""
        if ends.forbidden:
            message = "There is no way to the goal without the transitions that the body cannot carry out."
            return NotEstimable("contacts-unreachable", message, [Fault("goal", "out of reach")])
        if ends.obstacles:
            return _no_way_round([obstacle.name for obstacle in ends.obstacles])
        relaxed_schedule = build_schedule(ends, self.limits, regions_at, steps, self.limits.defaults.first_foot)
        if relaxed_schedule is None:
            message = f"There is no way to the goal in {steps} steps."
            return NotEstimable("contacts-unreachable", message, [Fault("goal", "out of reach")])
        program = StepProgram(relaxed_schedule, self.limits, ends, slack=True)
        answer = program.solve(budget, MISS_S)
        if answer.x is None or program.slack is None:
            return _timeout_error(self.seconds)
        worst = int(np.argmax(answer.x[list(program.slack)]))
        node, placed = relaxed_schedule.nodes[relaxed_schedule.moves[worst]], program.placements_of(answer)
        region = placed.regions[relaxed_schedule.moves[worst]]
        where = "the goal" if region is None else repr(region.surface)
        lacks = f"{node.effector} misses its limits by {answer.x[program.slack[worst]]:.2f} m"
        message = f"There is no way to the goal: at best, in step {node.step} to {where}, {lacks}."
        return NotEstimable("contacts-unreachable", message, [Fault(f"steps[{node.step}]", f"{where}: {lacks}")])


def _least_steps(ends: StartAndGoal, limits: RobotLimits) -> int:
    """Minimum number of steps of the robot's step length with turns up to ``TURN_MAX_RAD``; 0 if already there."""
    ways = [ends.goal[foot].position_m - ends.start[foot].position_m for foot in limits.feet]
    distances = [float(np.linalg.norm(way)) for way in ways]
    turns = [np.abs(ends.goal[foot].rotation - ends.start[foot].rotation).max() for foot in limits.feet]
    count = sum(bool(m > SAME_M or t > SAME_M) for m, t in zip(distances, turns, strict=True))
    if not count:
        return 0
    local = heading_frame(ends.yaw_rad).T @ np.mean(ways, axis=0)
    length = max(float(np.hypot(local[0], local[1])), abs(float(local[2])))
    walk = math.ceil(length / limits.defaults.step_m - 1e-6) + (count == 2)
    turning = math.ceil(abs(ends.turn_rad) / TURN_MAX_RAD - 1e-6)
    return max(count, walk, turning + (count == 2 and turning > 0), 3 * ends.aside_steps)


def _scenario_phases(plan: Schedule, placed: PlacedSchedule, limits: RobotLimits) -> list[dict[str, Any]]:
    """Phases of all moves that change a contact; every swing is a phase of its own."""
    times = limits.defaults
    standing = {name: at for name, i in plan.stances[0].items() if (at := placed.placements[i]) is not None}
    phases = [_phase_entry(times.ends_s, standing)]
    for i in plan.moves:
        name, at = plan.nodes[i].effector, placed.placements[i]
        before = standing.pop(name, None)
        if (
            at is not None
            and before is not None
            and _same_position(before, at)
            and plan.nodes[i].effector not in limits.feet
        ):
            standing[name] = before
            continue
        if at is None and before is None:
            continue
        if name in limits.feet and before is not None and at is not None:
            level = abs(at.position_m[2] - before.position_m[2]) < LEVEL_M
            swing_s = times.foot_move_s * (LEVEL_MOVE_SHARE if level else 1.0)
        else:
            swing_s = times.hand_move_s
        phases.append(_phase_entry(swing_s, standing))
        if at is not None:
            standing[name] = at
            phases.append(_phase_entry(times.rest_s, standing))
    phases[-1]["duration_s"] = min(times.ends_s, DURATION_S[1])
    return phases


def _phase_entry(duration_s: float, standing: Mapping[str, Placement]) -> dict[str, Any]:
    contacts = [
        {
            "effector": name,
            "position_m": [round(float(value), 6) + 0.0 for value in standing[name].position_m],
            "orientation_wxyz": [round(float(value), 9) + 0.0 for value in standing[name].wxyz],
        }
        for name in sorted(standing)
    ]
    return {"duration_s": round(duration_s, 6), "contacts": contacts}


def _same_position(one: Placement, other: Placement) -> bool:
    return bool(np.linalg.norm(one.position_m - other.position_m) < SAME_M)


def _gap_text(missing_m: tuple[float, float, float]) -> str:
    ways = (("ahead", "back"), ("left", "right"), ("up", "down"))
    parts = [f"{abs(v):.3f} m farther {way[v < 0]}" for v, way in zip(missing_m, ways, strict=True) if abs(v) > SAME_M]
    return " and ".join(parts)


def _no_way_round(names: Sequence[str]) -> NotEstimable:
    named = " and ".join(repr(name) for name in names)
    text = f"{named} can neither be stepped over nor passed below, and no sequence of steps leads around"
    faults = [Fault(f"terrain[{name}]", "it is in the way of every sequence of steps") for name in names]
    return NotEstimable("contacts-unreachable", f"There is no way to the goal: {text}.", faults)


def _timeout_error(seconds: float) -> NotEstimable:
    message = f"The planner found no sequence of contacts within {seconds:g} s of processor time."
    return NotEstimable("contact-plan-timeout", message)
