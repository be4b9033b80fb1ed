"""Speed of the centroidal stage on the thesis' experiments; run by ``make bench`` (skipped otherwise)."""

import pytest

from stridelab.centroidal.solve import solve
from stridelab.centroidal.transcription import transcribe
from support.talos_problems import bundled

EXPERIMENTS = ("long-stride", "six-stairs", "stairs-with-rail")


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_transcription(benchmark, scenario):
    problem = bundled(scenario)
    benchmark(lambda: transcribe(problem))


@pytest.mark.parametrize("scenario", EXPERIMENTS)
def test_build_and_solve(benchmark, scenario):
    problem = bundled(scenario)
    plan = benchmark.pedantic(lambda: solve(problem), rounds=3)
    benchmark.extra_info["iterations"] = plan.iterations
    benchmark.extra_info["solve_cpu_s"] = round(plan.solve_time_s, 3)
    benchmark.extra_info["build_cpu_s"] = round(plan.build_time_s, 3)
