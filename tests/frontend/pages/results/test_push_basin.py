"""The page of a push basin: counts, a map with every push, and the falls with their reasons."""

import re
from collections.abc import Callable

import httpx
import pytest

from stridelab.schemas.receding import PushBasinSummary
from stridelab_web.pages.results.push_basin import direction_name, draw_pushes
from support.browser.every_page import every_page, push_basin_result
from support.fakes.service import FakeService


def test_every_push_is_on_the_map_and_every_fall_in_the_table() -> None:
    summary, files = push_basin_result()
    chart, falls = draw_pushes(PushBasinSummary.model_validate(summary), files["pushes.parquet"])
    assert [mark.shape for mark in chart.marks] == ["circle", "triangle", "cross", "circle"]
    assert chart.marks[1].text.startswith("push 1, 2.00 s, 92°, left (y): fell, not proved inevitable. falls 1.57 s")
    assert chart.marks[3].text.endswith(": survived")
    assert [(fall["push"], fall["outcome"]) for fall in falls] == [
        (1, "fell, not proved inevitable"),
        (2, "fell, proved lost"),
    ]
    assert chart.caption == "Pushes by time and direction: 2 of 4 survived"


def test_the_page_counts_pushes_by_outcome(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    page = re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", browse(every_page(fake)["pushes"]).text))
    survived = "Survived: 2 of 4 pushes (15 to 85 %, 95 % confidence)"
    assert f"{survived}. Survived, 2 of them at the end of the plan, 1 with a completed motion." in page
    assert "Proved lost: 1; unexplained: 1." in page
    assert "Steps: pushes of 0.3" in page
    assert "2 falls" in page
    assert "no motion within the premises" in page


def test_a_scenario_offers_pushes(fake: FakeService, browse: Callable[[str], httpx.Response]) -> None:
    own = fake.add_scenario()
    page = browse(f"/scenarios/{own.id}").text
    assert f'data-basin="{own.id}"' in page
    for field in ("push_time_s", "push_x_ns", "push_link", "payload_kg", "replay_friction", "delay_ms", "estimated"):
        assert f'name="{field}"' in page


@pytest.mark.parametrize(
    ("degrees", "name"),
    [(0.0, "forwards (x)"), (-44.0, "forwards (x)"), (91.0, "left (y)"), (-91.0, "right"), (-179.0, "backwards")],
)
def test_directions_have_names(degrees: float, name: str) -> None:
    assert direction_name(degrees) == name
