"""How well phases are held, as the page of a scenario says it."""

import pytest

from stridelab.schemas.scenarios import ContactMargin, PhaseSupport, ScenarioCheck
from stridelab_web.charts.scenario_drawing import draw_scenario
from stridelab_web.pages.scenarios.equilibrium_table import (
    equilibrium_bars,
    equilibrium_summary,
    phase_equilibria,
    tightest_phase,
)
from support.fakes import robots

SCENARIO = robots.scenario()
SQUARE = [(0.0, 0.0), (0.2, 0.0), (0.2, 0.1), (0.0, 0.1)]


def judged(margins_m: list[float | None], regions: list[list[tuple[float, float]]]) -> ScenarioCheck:
    """An answer of the judge for the first phases of the scenario."""
    contacts = [
        ContactMargin(phase=1, effector="left_foot", surface="ground", height_m=0.0, edge_m=0.31, reach_m=0.2),
        ContactMargin(phase=1, effector="right_hand", surface="rail", height_m=0.0, edge_m=0.05, reach_m=0.12),
        ContactMargin(phase=2, effector="left_foot", surface=None, height_m=None, edge_m=None, reach_m=None),
    ]
    support = [
        PhaseSupport(phase=k, margin_m=margin_m, com_m=None if margin_m is None else (0.0, 0.0, 0.9))
        for k, margin_m in enumerate(margins_m)
    ]
    return ScenarioCheck(
        valid=True, errors=[], warnings=[], margins=contacts, support_region_m=regions, support=support, duration_s=6.0
    )


def test_a_phase_is_held_at_rest_only_in_motion_or_unknown() -> None:
    phases = phase_equilibria(SCENARIO, judged([0.06, -0.031, None, None], [SQUARE, SQUARE, [], SQUARE]))
    assert [phase.kind for phase in phases[:4]] == ["rest", "motion", "motion", "unknown"]
    assert [phase.kind_text for phase in phases[:4]] == [
        "yes",
        "only passed in motion",
        "only passed in motion",
        "not known",
    ]
    assert (phases[1].start_s, phases[1].end_s) == (1.0, 1.8)
    assert phases[1].effectors == "left foot, right hand"
    least = tightest_phase(phases)
    assert least is not None
    assert least.phase == 1
    assert equilibrium_summary(phases) == (
        "The robot could stop and rest in 1 of 9 phases. It has the least room in phase 1: 3.1 cm short."
    )


def test_the_worst_margin_of_a_phase_names_whose_it_is() -> None:
    phases = phase_equilibria(SCENARIO, judged([0.06, 0.05, 0.04], [SQUARE] * 3))
    assert phases[1].edge == (0.05, "right hand on rail")
    assert phases[1].reach_m == 0.12
    assert phases[2].edge is None
    assert phases[2].reach_m is None


def test_every_phase_has_its_bar() -> None:
    phases = phase_equilibria(
        SCENARIO, judged([0.06, *[0.06 - 1e-9] * 8], [SQUARE] * 9)
    )  # nothing that anybody could see
    bars = equilibrium_bars(phases, robots.duration_s(SCENARIO))
    assert [kind for kind, _ in bars] == ["rest"] * 9
    assert sum(bar.width for _, bar in bars) == pytest.approx(100, abs=0.01)
    assert equilibrium_summary(phases).startswith(
        "The robot could stop and rest in every phase. It has the least room in phase 0: 6.0"
    )


def test_a_region_is_drawn_from_above_where_there_is_one() -> None:
    def regions(region_m: list[tuple[float, float]]) -> list[str]:
        picture = draw_scenario(SCENARIO, "above", region_m)
        assert picture is not None
        return [shape.points for shape in picture.shapes if shape.css == "support"]

    assert regions([]) == []
    (points,) = regions(SQUARE)
    px = [tuple(map(float, corner.split(","))) for corner in points.split()]
    assert px[1][0] - px[0][0] == pytest.approx(0.2 * 200, abs=0.11)
    assert px[0][1] - px[3][1] == pytest.approx(0.1 * 200, abs=0.11), "y points up on the page"
