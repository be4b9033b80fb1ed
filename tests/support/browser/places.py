"""Places on the plan of a terrain, in metres and on the page."""

from playwright.sync_api import Page

ON_PAGE = """([x, y]) => {
    const svg = document.querySelector("[data-plan-view]"), { left, top } = svg.getBoundingClientRect();
    const scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
    const along = (css, axis) => [...svg.querySelectorAll(css)].map((tick) =>
        [Number(tick.textContent), Number(tick.getAttribute(axis))]);
    const at = (ticks, value) => {
        const [[a, u], [b, v]] = [ticks[0], ticks[ticks.length - 1]];
        return u + ((value - a) / (b - a)) * (v - u);
    };
    const texts = "text.tick:not(.y):not(.unit)", sides = "text.tick.y:not(.unit)";
    return [left + at(along(texts, "x"), x) * scale, top + (at(along(sides, "y"), y) - 4) * scale];
}"""
"""Read off the axes, as a person does; the text of a tick at the side is 4 px below its line."""


def click_at_place(page: Page, x_m: float, y_m: float) -> None:
    """Click on a place of the terrain."""
    plan = page.locator("[data-plan-view]")
    plan.scroll_into_view_if_needed()
    x_px, y_px = page.evaluate(ON_PAGE, [x_m, y_m])
    page.mouse.click(x_px, y_px)
