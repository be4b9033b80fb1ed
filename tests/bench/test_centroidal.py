"""Speed of the centroidal stage on the thesis' experiments; run by ``make bench`` (skipped otherwise)."""

import pytest

from stridelab.centroidal import programme
from stridelab.centroidal.contact_wrench import ContactWrench
from stridelab.centroidal.freedom import FreeDurations, FreePlacements
from stridelab.centroidal.point_forces import CircularCones, Pyramids
from stridelab.centroidal.solve import solve
from stridelab.centroidal.transcription import transcribe
from support.talos_problems import bundled

EXPERIMENTS = ("long-stride", "six-stairs", "stairs-with-rail")
CONTROLS = {"u_f": Pyramids(), "u_f circular": CircularCones(), "u_c": ContactWrench()}
FREE = {
    "durations": {"durations": FreeDurations()},
    "placements": {"placements": FreePlacements()},
}


def note(benchmark, plan):
    benchmark.extra_info["iterations"] = plan.iterations
    benchmark.extra_info["converged"] = plan.converged
    benchmark.extra_info["solve_cpu_s"] = round(plan.solve_time_s, 3)
    benchmark.extra_info["build_cpu_s"] = round(plan.build_time_s, 3)


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_compiling_a_structure(benchmark, scenario, monkeypatch):
    problem = bundled(scenario)

    def forget():
        monkeypatch.setattr(programme, "_kept", {})

    benchmark.pedantic(lambda: transcribe(problem), setup=forget, rounds=3)


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_numbers_for_a_structure_that_is_known(benchmark, scenario):
    problem = bundled(scenario)
    benchmark(lambda: transcribe(problem))


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_solve(benchmark, scenario, control):
    problem = bundled(scenario, control=CONTROLS[control])
    note(benchmark, benchmark.pedantic(lambda: solve(problem), rounds=3, warmup_rounds=1))


@pytest.mark.parametrize("free", FREE)
@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_solve_with_freedom(benchmark, scenario, free):
    problem = bundled(scenario, **FREE[free])
    note(benchmark, benchmark.pedantic(lambda: solve(problem), rounds=1))


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_warm_start(benchmark, scenario):
    problem = bundled(scenario)
    solution = solve(problem).solution
    note(benchmark, benchmark.pedantic(lambda: solve(problem, start=solution.point), rounds=3))
