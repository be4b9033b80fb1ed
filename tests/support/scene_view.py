"""What the viewer's frame shows, asked of the browser: where nodes are, and where they are on the page."""

from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from support.tab import Tab

NODES = """(names) => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable;
    return Object.fromEntries(names.map((name) => {
        const object = viser.nodeRefFromName[name];
        return [name, {
            position: object.position.toArray(),
            wxyz: [object.quaternion.w, ...object.quaternion.toArray().slice(0, 3)],
            scale: object.scale.toArray(),
        }];
    }));
}"""
ON_SCREEN = """(place) => {
    const frame = document.querySelector("iframe");
    const viser = frame.contentWindow.__viserMutable;
    const node = viser.nodeRefFromName[typeof place === "string" ? place : ""];
    const own = typeof place === "string" ? [0, 0, 0] : place;
    const at = node.localToWorld(viser.camera.position.clone().set(...own));
    viser.camera.updateMatrixWorld();
    const seen = at.project(viser.camera);
    const box = frame.getBoundingClientRect(), inside = viser.canvas.getBoundingClientRect();
    return [
        box.left + inside.left + (seen.x + 1) / 2 * inside.width,
        box.top + inside.top + (1 - seen.y) / 2 * inside.height,
    ];
}"""
"""Where a node, or a point of the world, is on the page, by the camera of the scene."""


def opened(tab: Tab, address: str) -> Page:
    """A page of the viewer whose scene is complete."""
    page = tab.go(address)
    page.wait_for_selector("[data-ready]", timeout=90_000)
    return page


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Wait for what comes with one of the next pictures."""
    for _ in range(150):
        if holds():
            return
        page.wait_for_timeout(100)
    raise AssertionError("the page does not come to the state that was asked for")


def nodes(page: Page, *names: str) -> dict[str, Any]:
    """Position, quaternion and scale of nodes, as they are drawn."""
    found: dict[str, Any] = page.evaluate(NODES, list(names))
    return found


def drag(page: Page, node: str, to_m: tuple[float, float, float]) -> None:
    """Take hold of a mark in its middle and let go of it where ``to_m`` is in the picture."""
    hold(page, node, to_m)
    page.mouse.up()


def hold(page: Page, node: str, to_m: tuple[float, float, float]) -> None:
    """Take hold of a mark in its middle and move it to where ``to_m`` is in the picture, without letting go."""
    x, y = page.evaluate(ON_SCREEN, node)
    u, v = page.evaluate(ON_SCREEN, list(to_m))
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 9):
        page.mouse.move(x + (u - x) * k / 8, y + (v - y) * k / 8)
        page.wait_for_timeout(40)
