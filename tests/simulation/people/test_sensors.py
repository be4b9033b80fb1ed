"""Sensors of drawn people: without errors they measure the truth, and every error does what it is named for."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import experiments.people as people
from experiments.people.movements import MOVEMENTS, Movement
from experiments.people.sensors import SensorErrors, draw_recording
from stridelab.dynamics.wrench import Wrench, momentum_rate

NONE = SensorErrors(
    table_mass=0.0,
    table_lever=0.0,
    trunk_m=(0.0, 0.0),
    tissue_m=0.0,
    marker_m=0.0,
    loaded=0.0,
    plate_n=0.0,
    plate_nm=0.0,
    drift_n_s=0.0,
    noise_n=0.0,
    noise_nm=0.0,
    late_s=(0.0, 0.0),
    mass_share=0.0,
)


def test_the_generator_shares_no_code_with_an_estimator() -> None:
    for path in Path(people.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith(("stridelab.estimation", "stridelab.simulation.human")) for name in names)


@pytest.mark.parametrize("movement", MOVEMENTS)
def test_without_errors_the_sensors_measure_the_truth(movement: Movement) -> None:
    drawn = draw_recording(3, movement, replace(NONE, late_s=(0.012, 0.012)))
    wrench = drawn.wrench_at(0.012)
    inside = slice(10, -10)
    # Half of the markers are low-passed to 6 or 10 Hz, which rounds the turning points of a hop.
    assert np.abs(drawn.geometric.com_m - drawn.com_m)[:, :2].max() < 0.003
    assert wrench.force_n[inside] == pytest.approx(drawn.force_n[inside], abs=0.02 * drawn.force_n[:, 2].max())
    implied = momentum_rate(drawn.com_m, Wrench(wrench.force_n, wrench.moment_nm))[inside]
    assert np.abs(implied.mean(axis=0)[:2]).max() < 12.0
    late = drawn.wrench_at(0.0).force_n[inside] - drawn.force_n[inside]
    assert np.sqrt(np.mean(late**2)) > 2.0 * np.sqrt(np.mean((wrench.force_n[inside] - drawn.force_n[inside]) ** 2))


def test_the_tables_error_follows_the_posture() -> None:
    moving = []
    for seed in range(8):
        drawn = draw_recording(seed, "walk", replace(NONE, table_mass=0.12, table_lever=0.03))
        moving.append((drawn.geometric.com_m - drawn.com_m).std(axis=0)[0])
    assert 0.0003 < np.median(moving) < 0.006


def test_an_unseen_load_displaces_the_geometry_and_not_the_truth() -> None:
    errors = replace(NONE, loaded=1.0)
    off = [
        np.linalg.norm(
            (draw_recording(s, "stand", errors).geometric.com_m - draw_recording(s, "stand", errors).com_m).mean(axis=0)
        )
        for s in range(6)
    ]
    assert 0.002 < np.median(off) < 0.03


def test_a_walk_across_plates_has_force_for_one_and_a_half_steps() -> None:
    durations = set()
    for seed in range(12):
        drawn = draw_recording(seed, "walk")
        durations.add(round(drawn.window.duration_s, 1))
        complete = drawn.wrench_at(0.0).complete
        assert complete.any()
    assert min(durations) < 1.3
    assert max(durations) > 5.0


def test_the_same_seed_is_the_same_recording() -> None:
    first, again = draw_recording(11, "run"), draw_recording(11, "run")
    assert np.array_equal(first.geometric.com_m, again.geometric.com_m)
    assert np.array_equal(first.wrench_at(0.0).moment_nm, again.wrench_at(0.0).moment_nm)
    assert not np.array_equal(first.geometric.com_m, draw_recording(12, "run").geometric.com_m)
