"""A page in Chromium as the tests drive it, and the scene that it draws.

Coroutines in a thread of their own: the loop of a browser test's thread belongs to Playwright.

A page of a running service that remembers what went wrong in it.

Where the page's own modules put the links of a plan, at any instant and between two frames.

What the viewer's frame shows, asked of the browser: where nodes are, and where they are on the page.

What static/js/viewer/frame_decoder.js does, with numpy.
"""

import asyncio
import json
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

import numpy as np
from playwright.sync_api import ConsoleMessage, Locator, Page, Request, WebSocket

from stridelab.client import Client

Answer = TypeVar("Answer")


FETCHED = """() => [window, ...[...document.querySelectorAll("iframe")].map((frame) => frame.contentWindow)]
    .flatMap(({ performance }) => ["navigation", "resource"].flatMap((kind) => performance.getEntriesByType(kind)))
    .map(({ name, transferSize }) => [name, transferSize])"""
"""What the page and its frames requested, and the bytes of each that crossed the network."""
RINGED = """() => {
    const focused = document.activeElement;
    if (focused === document.body) return true;
    const drawn = focused.matches("[type=file]") ? focused.labels[0] : focused;
    const ring = focused.matches("iframe")
        ? getComputedStyle(focused.parentElement, "::after") : getComputedStyle(drawn);
    const { width, height } = drawn.getBoundingClientRect();
    return ring.outlineStyle !== "none" && parseFloat(ring.outlineWidth) > 0 && width > 0 && height > 0;
}"""
"""Whether what has the focus is seen to have it."""
DRAWN_OVER = """(names) => names.map((name) => {
    let material = null;
    document.querySelector("iframe").contentWindow.__viserMutable.nodeRefFromName[name].traverse((part) => {
        material ??= part.material ?? null;
    });
    return !material.depthTest;
})"""
"""Whether these nodes of a scene are drawn over the body."""


def run(work: Coroutine[None, None, Answer]) -> Answer:
    """Run ``work`` in the loop and return its result."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(work)).result()


TEN_PICTURES_A_SECOND = """
    const draw = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (picture) => setTimeout(() => draw(picture), window.top?.pictureMs ?? 90);
    window.cancelAnimationFrame = clearTimeout;
"""
"""Or as many as there is processor for, without a graphics card, and nothing left for what is tested."""
TWO_PICTURES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
"""What the page has received by now is drawn when this has ended."""
WITHOUT_DRAWING = """
    for (const context of [WebGLRenderingContext, WebGL2RenderingContext])
        for (const name of ["clear", "drawArrays", "drawArraysInstanced", "drawElements", "drawElementsInstanced"])
            if (name in context.prototype) context.prototype[name] = () => {};
"""
"""A scene is built, its shaders are compiled and its nodes move; only its triangles are not filled with colour, which
takes a quarter of the processor time of a test where there is no graphics card."""


def prepare_pictures(page: Page, *, drawn: bool) -> None:
    """Limit the pictures of scenes, and without ``drawn`` leave them empty; before the page is loaded."""
    page.add_init_script(TEN_PICTURES_A_SECOND)
    if not drawn:
        page.add_init_script(WITHOUT_DRAWING)


VISER_DRAGS = "Unable to preventDefault inside passive event listener invocation."
"""viser's drag of a node says so in Chromium; the drag works."""


@dataclass(frozen=True)
class Service:
    """A running ``stridelab serve``; one of its own has the process ``pid`` and keeps its data in ``data``."""

    url: str
    client: Client
    pid: int | None = None
    data: Path | None = None


@dataclass
class Tab:
    """A page that remembers what went wrong in it."""

    page: Page
    url: str
    missteps: list[str] = field(default_factory=list)

    def go(self, address: str) -> Page:
        self.page.goto(f"{self.url}{address}")
        return self.page

    def on_console(self, message: ConsoleMessage) -> None:
        if message.type == "error" and message.text != VISER_DRAGS:
            self.missteps.append(f"console: {message.text} ({message.location.get('url')})")

    def on_error(self, error: Exception) -> None:
        self.missteps.append(f"error: {error}")

    def on_websocket(self, socket: WebSocket) -> None:
        if urlsplit(socket.url).netloc != urlsplit(self.url).netloc:
            self.missteps.append(f"outside: {socket.url}")

    def on_request(self, request: Request) -> None:
        if urlsplit(request.url).scheme in ("http", "https", "ws") and not request.url.startswith(self.url):
            self.missteps.append(f"outside: {request.url}")


START = """async (base) => {
    const { Scene } = await import("/static/js/viewer/scene.js");
    const { decodeFrames } = await import("/static/js/viewer/frame_decoder.js");
    const [layout, values] = decodeFrames(await fetch(`${base}/frames.bin`).then((answer) => answer.arrayBuffer()));
    window.ownScene = new Scene(document.querySelector("iframe"), layout, values);
    return { links: layout.bodies, time_s: layout.time_s };
}"""
SENT_POSES = """(frames) => frames.map((at) => {
    const scene = window.ownScene;
    scene.interpolate(at);
    return scene.layout.bodies.flatMap(([, k]) => [...scene.row.slice(k, k + 3), ...scene.quaternionAt(k)]);
})"""
DRAWN = """async (at) => {
    const scene = window.ownScene, viser = document.querySelector("iframe").contentWindow.__viserMutable;
    scene.show(at);
    const names = scene.layout.bodies.map(([name]) => name);
    const waits = () => names.some((name) => viser.nodePoseData[name].poseUpdateState === "needsUpdate");
    while (waits()) await new Promise((done) => setTimeout(done, 20));
    return names.flatMap((name) => {
        const object = viser.nodeRefFromName[name];
        return [...object.position.toArray(), object.quaternion.w, ...object.quaternion.toArray().slice(0, 3)];
    });
}"""


class ScenePoses:
    """The modules of the viewer's page on the plan that ``page`` shows at ``address`` (``Document.address``)."""

    def __init__(self, page: Page, address: str) -> None:
        self._page = page
        session: dict[str, Any] = page.evaluate(START, address)
        self.links = [name for name, _ in session["links"]]
        self.time_s = np.array(session["time_s"])

    def as_sent(self, time_s: np.ndarray) -> np.ndarray:
        """Poses ``(n, links, 7)`` at instants, as they are handed to viser."""
        rows = self._page.evaluate(SENT_POSES, self._frames(time_s).tolist())
        return np.array(rows, dtype=float).reshape(len(time_s), -1, 7)

    def as_drawn(self, time_s: float) -> np.ndarray:
        """Poses ``(links, 7)`` of the nodes of the picture."""
        (at,) = self._frames(np.array([time_s]))
        return np.array(self._page.evaluate(DRAWN, float(at)), dtype=float).reshape(-1, 7)

    def _frames(self, time_s: np.ndarray) -> np.ndarray:
        return np.asarray(np.interp(time_s, self.time_s, np.arange(len(self.time_s))))


def apart(shown: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """The largest distance in metres and the largest turn in radians between poses ``(..., 7)``."""
    distance_m = np.linalg.norm(shown[..., :3] - expected[..., :3], axis=-1)
    unit = [poses[..., 3:] / np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True) for poses in (shown, expected)]
    half = np.minimum(np.linalg.norm(unit[0] - unit[1], axis=-1), np.linalg.norm(unit[0] + unit[1], axis=-1)) / 2
    return float(distance_m.max()), float((4 * np.arcsin(half)).max())


NODES = """(names) => {
    const viser = document.querySelector("iframe").contentWindow.__viserMutable;
    return Object.fromEntries(names.map((name) => {
        const object = viser.nodeRefFromName[name];
        return [name, {
            position: object.position.toArray(),
            wxyz: [object.quaternion.w, ...object.quaternion.toArray().slice(0, 3)],
            scale: object.scale.toArray(),
            drawn: object.layers.mask !== 0,
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


def focus_by_tab(page: Page, target: Locator, at_most: int = 120) -> None:
    """Press Tab until ``target`` has the focus, each time with a visible ring."""
    for _ in range(at_most):
        page.keyboard.press("Tab")
        assert page.evaluate(RINGED), page.evaluate("document.activeElement.outerHTML.slice(0, 200)")
        if target.evaluate("(one) => one === document.activeElement"):
            return
    raise AssertionError(f"{target} is not reached by Tab")


class Mouse:
    """Clicks as a person does, counts them, and fails at the first one beyond ``at_most``."""

    def __init__(self, at_most: int) -> None:
        self.at_most = at_most
        self.clicks = 0

    def click(self, target: Locator) -> None:
        self._count(1)
        target.click()

    def choose(self, target: Locator, value: str) -> None:
        """Opening a list is one click and its option another."""
        self._count(2)
        target.select_option(value)

    def fill(self, target: Locator, value: str) -> None:
        """One click into the field; the keys are not counted."""
        self._count(1)
        target.fill(value)

    def _count(self, number: int) -> None:
        self.clicks += number
        assert self.clicks <= self.at_most, f"click {self.clicks} of at most {self.at_most}"


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Wait for what comes with one of the next pictures."""
    for _ in range(150):
        if holds():
            return
        page.wait_for_timeout(100)
    raise AssertionError("the page does not come to the state that was asked for")


@contextmanager
def few_pictures(page: Page) -> Iterator[None]:
    """One picture of a scene per second while the test waits for a computation, not ten.

    Without a graphics card ten pictures take half a core from what is being waited for.
    """
    page.evaluate("() => { window.pictureMs = 1000; }")
    yield
    page.evaluate("() => { delete window.pictureMs; }")


def nodes(page: Page, *names: str) -> dict[str, Any]:
    """Position, quaternion and scale of nodes, and whether they are drawn at all."""
    poses: dict[str, Any] = page.evaluate(NODES, list(names))
    return poses


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


def read_frames(file: bytes) -> tuple[dict[str, Any], np.ndarray]:
    """Layout and numbers of ``frames.bin``."""
    end = 4 + int.from_bytes(file[:4], "little")
    layout: dict[str, Any] = json.loads(file[4:end])
    return layout, unpack(file[end:], layout)


def unpack(packed: bytes, layout: dict[str, Any]) -> np.ndarray:
    """The numbers as float32 ``(frames, width)``."""
    n, width = layout["n_frames"], layout["width"]
    planes = np.frombuffer(packed, np.uint8).reshape(5, width, n).astype(np.int64)
    unsigned = sum(planes[1 + k] << (8 * k) for k in range(4))
    bend = (unsigned >> 1) ^ -(unsigned & 1)
    whole = bend.cumsum(axis=1).cumsum(axis=1)
    values = whole * 2.0 ** -np.array(layout["bits"])[:, None]
    return np.where(planes[0] == 1, np.nan, values).T.astype(np.float32)
