"""Where a scenario has a motion, as a curve and as maps: every combination is drawn, and says what became of it."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stridelab.schemas.sweeps import SweepAxis, SweepSummary
from stridelab_web.pages.results.sweep import MAX_MAPS, SweepGrid, sweep_headline

STRIDE = SweepAxis(field="stride", unit="m", values=[0.5, 1.0, 1.5], present=0.9)
FRICTION = SweepAxis(field="friction", unit="", values=[0.2, 0.4], present=0.3)
OUTCOMES = ["feasible", "feasible", "infeasible", "feasible", "refused", "refused"]


def summary_of(*axes: SweepAxis, outcomes: list[str]) -> SweepSummary:
    return SweepSummary(
        scenario_name="Steps",
        robot="talos",
        axes=list(axes),
        points=len(outcomes),
        feasible=outcomes.count("feasible"),
        refused=outcomes.count("refused"),
        infeasible=outcomes.count("infeasible"),
        failed=0,
        solvers={"native": 4},
        solve_time_s=0.01,
        wall_time_s=1.0,
        processes=2,
        warnings=[],
    )


def swept(*axes: SweepAxis, outcomes: list[str]) -> SweepGrid:
    summary = summary_of(*axes, outcomes=outcomes)
    costs = [1.5 if outcome == "feasible" else float("nan") for outcome in outcomes]
    why = ["" if outcome == "feasible" else f"<{outcome}>" for outcome in outcomes]
    file = io.BytesIO()
    pq.write_table(pa.table({"outcome": outcomes, "objective": costs, "why": why}), file)
    return SweepGrid.from_table(summary, file.getvalue())


def test_a_map_has_a_cell_for_every_combination() -> None:
    ((title, chart),) = swept(STRIDE, FRICTION, outcomes=OUTCOMES).draw_charts()
    assert title == ""
    assert chart.caption == "stride against friction: 3 of 6 feasible"
    assert [band.css for band in chart.bands] == [f"cell {outcome}" for outcome in OUTCOMES]
    assert chart.bands[2].text == "stride 1 m, friction 0.2: no motion found: <infeasible>"
    assert chart.bands[3].text == "stride 1 m, friction 0.4: has a motion, cost 1.500"
    # Cells fill the chart without gaps: the second stride begins where the first one ends.
    left, right = (np.array([float(p.split(",")[0]) for p in chart.bands[k].points.split()]) for k in (0, 2))
    assert left.max() == right.min()
    assert left.min() == chart.left


def test_a_curve_shows_the_cost_and_where_there_is_none() -> None:
    ((_, chart),) = swept(STRIDE, outcomes=["feasible", "feasible", "refused"]).draw_charts()
    assert [shade.css for shade in chart.shades] == ["cell refused"]
    assert "<refused>" in chart.shades[0].text
    assert len(chart.marks) == 2


def test_a_third_field_has_a_map_for_each_of_its_values() -> None:
    timing = SweepAxis(field="timing", unit="", values=[1.0 + 0.1 * k for k in range(MAX_MAPS + 2)], present=1.0)
    result = swept(STRIDE, FRICTION, timing, outcomes=["feasible"] * 6 * len(timing.values)).draw_charts()
    assert [title for title, _ in result][:2] == ["timing 1", "timing 1.1"]
    assert len(result) == MAX_MAPS


def test_the_borders_have_numbers() -> None:
    assert swept(STRIDE, FRICTION, outcomes=OUTCOMES).feasible_ranges() == [
        ("friction 0.2", "0.5 to 0.5 m, 1 of 3"),
        ("friction 0.4", "0.5 to 1 m, 2 of 3"),
    ]
    assert swept(STRIDE, outcomes=["refused"] * 3).feasible_ranges() == [("stride", "nowhere")]


def test_one_value_alone_is_a_cell() -> None:
    alone = SweepAxis(field="friction", unit="", values=[0.3], present=0.3)
    ((_, chart),) = swept(STRIDE, alone, outcomes=["feasible", "feasible", "failed"]).draw_charts()
    assert len(chart.bands) == 3


def test_the_headline_says_what_has_a_motion() -> None:
    """A motion of the centre of mass is not called one of the robot."""
    summary = summary_of(STRIDE, outcomes=["feasible", "infeasible", "refused"])
    assert sweep_headline(summary) == (
        "The centre of mass alone has a motion in 1 of 3 scenarios; 1 rejected before solving, 1 without a motion."
    )
    whole = summary.model_copy(update={"scope": "whole body", "refused": 0, "infeasible": 0, "feasible": 3})
    assert sweep_headline(whole) == "The robot has a certified motion in 3 of 3 scenarios."
