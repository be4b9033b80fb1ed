"""Speed of the centroidal stage on the thesis' experiments; run by ``make bench`` (skipped otherwise).

The clock is that of the processor: what else the machine does counts for little. "First" is all that a structure takes
that was never seen, "again" one that is known.
"""

import time
from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.infeasibility.diagnosis import diagnose
from stridelab.centroidal.nlp import nlp
from stridelab.centroidal.nlp.transcription import transcribe
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.receding_horizon import RecedingHorizon, State
from stridelab.centroidal.solver import solve
from support.robots.sequences import bundled

pytestmark = pytest.mark.benchmark(timer=time.process_time)

EXPERIMENTS = ("long-stride", "six-stairs", "stairs-with-rail")
CONTROLS = {"u_f": Pyramids(), "u_c": ContactWrench()}
SOLVERS = ("ipopt", "fatrop")
OTHERS = {
    "u_f circular": {"control": CircularCones()},
    "u_f cubic": {"shape": "cubic"},
    "durations": {"durations": FreeDurations()},
    "placements": {"placements": FreePlacements()},
}
AT_S, PERIOD_S = 6.0, 0.1


def note(benchmark, plan):
    benchmark.extra_info["iterations"] = plan.iterations
    benchmark.extra_info["converged"] = plan.converged
    benchmark.extra_info["solve_cpu_s"] = round(plan.solve_time_s, 3)
    benchmark.extra_info["build_cpu_s"] = round(plan.build_time_s, 3)
    benchmark.extra_info["cost"] = round(plan.objective, 3)


@pytest.fixture
def forget(monkeypatch):
    return lambda: monkeypatch.setattr(nlp, "_compiled_programs", {})


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_compiling_a_structure(benchmark, scenario, forget):
    problem = bundled(scenario)
    benchmark.pedantic(lambda: transcribe(problem), setup=forget, rounds=3)


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_numbers_for_a_structure_that_is_known(benchmark, scenario):
    problem = bundled(scenario)
    benchmark(lambda: transcribe(problem))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_first_solve(benchmark, scenario, control, solver, forget):
    problem = bundled(scenario, control=CONTROLS[control])
    note(benchmark, benchmark.pedantic(lambda: solve(problem, solver), setup=forget, rounds=1))


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_solve_again(benchmark, scenario, control, solver):
    problem = bundled(scenario, control=CONTROLS[control])
    rounds = 3 if solver == "ipopt" else 1
    note(benchmark, benchmark.pedantic(lambda: solve(problem, solver), rounds=rounds, warmup_rounds=1))


@pytest.mark.parametrize("what", OTHERS)
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_solve_otherwise(benchmark, scenario, what):
    problem = bundled(scenario, **OTHERS[what])
    note(benchmark, benchmark.pedantic(lambda: solve(problem, "ipopt"), rounds=1, warmup_rounds=1))


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_warm_start(benchmark, scenario):
    problem = bundled(scenario)
    solution = solve(problem, "ipopt").solution
    note(benchmark, benchmark.pedantic(lambda: solve(problem, "ipopt", start=solution.point), rounds=3))


@pytest.mark.parametrize("start", ["warm", "cold"])
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_receding_replan(benchmark, scenario, start):
    """One replan in the middle of a motion, a push of 5 cm/s to the side after the one before."""
    horizon = RecedingHorizon(problem=bundled(scenario), period_s=PERIOD_S, warm=start == "warm")
    plan = solve(horizon.problem, "ipopt")
    there = plan.reference_at(AT_S)
    before = horizon.solve_from(AT_S, State(there.com_m, there.com_v_m_s, there.l_nms))
    then = before.plan.reference_at(PERIOD_S)
    pushed = State(then.com_m, then.com_v_m_s + np.array([0.0, 0.05, 0.0]), then.l_nms)
    result = benchmark.pedantic(lambda: horizon.solve_from(AT_S + PERIOD_S, pushed, before), rounds=10, warmup_rounds=1)
    benchmark.extra_info["iterations"] = result.iterations
    benchmark.extra_info["found"] = not result.carried_on


def test_diagnosis(benchmark):
    """Of the long strides with 0.06 s for every phase, in which no body gets anywhere."""
    problem = bundled("long-stride")
    phases = tuple(replace(phase, duration_s=0.06) for phase in problem.sequence.phases)
    hurried = replace(problem, sequence=replace(problem.sequence, phases=phases))
    plan = solve(hurried, "ipopt")
    result = benchmark.pedantic(lambda: diagnose(hurried, plan), rounds=1)
    benchmark.extra_info["converged"] = plan.converged
    benchmark.extra_info["findings"] = len(result.findings)
