"""Pictures of every page at both sizes, kept in the folder that STRIDELAB_SCREENSHOTS names, for people to look at."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from support.every_page import every_page
from support.fake_lab import Lab
from support.tab import Tab

pytestmark = pytest.mark.usefixtures("lab")

SIZES = ((1400, 850), (800, 600))
LEAST_BYTES = 4_000
"""An empty page is smaller."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    named = os.environ.get("STRIDELAB_SCREENSHOTS")
    found = Path(named) if named else tmp_path
    found.mkdir(parents=True, exist_ok=True)
    return found


@pytest.mark.timeout(600)
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_every_page_is_pictured(open_tab: Callable[..., Tab], lab: Lab, folder: Path, width: int, height: int) -> None:
    tab = open_tab(width, height)
    for name, address in every_page(lab.fake).items():
        page = tab.go(address)
        if name.startswith("view-"):
            page.wait_for_selector("[data-ready]", timeout=90_000)
        elif page.locator("#plots").count():
            page.wait_for_selector("#plots[data-ready]")
        path = folder / f"{name}-{width}x{height}.png"
        page.screenshot(path=path, full_page=not name.startswith("view-"))
        assert path.stat().st_size > LEAST_BYTES, f"{name} is empty at {width}x{height}"
    tab.missteps = [m for m in tab.missteps if "status of 404" not in m]
