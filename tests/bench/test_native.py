"""The C++ solver on the thesis' experiments, cold and receding; run by ``make bench`` (skipped otherwise).

ipopt and fatrop on the same problems are rows of ``test_centroidal``.
"""

from dataclasses import replace

import numpy as np
import pytest

from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.native.availability import NativeUnavailable, native_availability
from stridelab.centroidal.native.problem_arrays import native_input
from stridelab.centroidal.native.solve import OPTIMALITY_GAP, TOLERANCE
from stridelab.centroidal.point_forces import CircularCones
from stridelab.centroidal.receding_horizon import RecedingHorizon
from stridelab.centroidal.solver import solve
from support.robots.sequences import bundled

EXPERIMENTS = ("long-stride", "six-stairs", "stairs-with-rail")
solver = native_availability()
if isinstance(solver, NativeUnavailable):
    pytest.skip(f"no native solver: {solver.reason}", allow_module_level=True)


KINDS = {
    "u_f": {"control": CircularCones()},
    "u_c": {"control": ContactWrench()},
    "u_f, free durations": {"control": CircularCones(), "durations": FreeDurations()},
    "u_f, free placements": {"control": CircularCones(), "placements": FreePlacements()},
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_native_solver_cold(benchmark, scenario, kind):
    """The solver alone."""
    problem = solver.module.problem(*native_input(bundled(scenario, **KINDS[kind])).module_arguments())
    result = benchmark(lambda: problem.solve(300, 10.0, TOLERANCE, OPTIMALITY_GAP, False))
    benchmark.extra_info["iterations"] = result["iterations"]
    benchmark.extra_info["solve_cpu_ms"] = round(1e3 * result["cpu_s"], 2)


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_native_plan_cold(benchmark, scenario):
    """With all that Python does around it: arrays, checks, the plan."""
    problem = bundled(scenario, control=CircularCones())
    plan = benchmark(lambda: solve(problem, "native"))
    benchmark.extra_info["iterations"] = plan.iterations


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_native_receding_horizon(benchmark, scenario):
    """All replans of a motion that is pushed by up to 1 cm/s after every one."""
    horizon = RecedingHorizon(problem=bundled(scenario, control=CircularCones()))

    def all_of_it():
        rng = np.random.default_rng(0)
        shove = lambda t, s: replace(s, com_v_m_s=s.com_v_m_s + np.append(rng.uniform(-0.01, 0.01, 2), 0.0))  # noqa: E731
        return list(horizon.iterate_replans(shove))

    replans = benchmark.pedantic(all_of_it, rounds=1)
    ms = [1e3 * r.plan.solve_time_s for r in replans[1:]]
    benchmark.extra_info["solves"] = len(ms)
    benchmark.extra_info["solve_cpu_median_ms"] = round(float(np.median(ms)), 2)
    benchmark.extra_info["solve_cpu_p99_ms"] = round(float(np.percentile(ms, 99)), 2)
    benchmark.extra_info["carried_on"] = sum(r.carried_on for r in replans)
