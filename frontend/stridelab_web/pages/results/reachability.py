"""Shared by the pages of robots and of jobs that learn densities: cards, and the figures of section 4.3."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import JobResult
from stridelab.schemas.reachability import EffectorReach, RobotReachability
from stridelab.schemas.robots import ProxyCard, ProxySize
from stridelab_web.api_client import JobFiles, client_of
from stridelab_web.charts.svg import SHAPES, Chart, Shape
from stridelab_web.formatting import code_words
from stridelab_web.pages.results.summary_facts import Fact
from stridelab_web.pages.terms.robots import DENSITY_TERMS

WIDTH_PX, HEIGHT_PX = 560.0, 330.0
ABOVE: Final = 1.06
"""Height of the axis over the highest divergence."""
NEAR: Final = 2.0
"""The second chart shows divergences below this multiple of the smallest one."""
COLOURS: Final = 6


def style_of(index: int) -> tuple[str, Shape]:
    """How the effector ``index`` of a robot is drawn: a colour and a shape."""
    return f"group{index % COLOURS}", SHAPES[index % len(SHAPES)]


def divergence_charts(cards: Sequence[ProxyCard]) -> list[Chart]:
    """Figure 4.3, whole and near its floor: divergence over the number of components, with bands of a standard error.

    The chosen size has the effector's mark, that of the thesis a ring. Empty if no card has a curve.
    """
    if not any(card.sizes for card in cards):
        return []
    whole = [sorted(card.sizes, key=lambda size: size.components) for card in cards]
    least = [min((size.kl_nats for size in sizes), default=0.0) for sizes in whole]
    near = [[size for size in sizes if size.kl_nats < NEAR * low] for sizes, low in zip(whole, least, strict=True)]
    return [
        _divergence_chart(
            cards, whole, "Divergence of the mixture from the kernel density over its number of components."
        ),
        _divergence_chart(cards, near, "The same near its minimum."),
    ]


def _divergence_chart(cards: Sequence[ProxyCard], curves: Sequence[Sequence[ProxySize]], caption: str) -> Chart:
    drawn = [size for sizes in curves for size in sizes]
    last, high = max(size.components for size in drawn), max(size.kl_nats + size.kl_sd_nats for size in drawn)
    canvas = Chart(
        (0.0, last + 1.0), (0.0, ABOVE * high), "components of the mixture", "KL(kernels || mixture) [nats]",
        WIDTH_PX, HEIGHT_PX,
    )  # fmt: skip
    for k, (card, sizes) in enumerate(zip(cards, curves, strict=True)):
        css, shape = style_of(k)
        x = np.array([size.components for size in sizes], dtype=float)
        kl, sd = (np.array([getattr(size, key) for size in sizes]) for key in ("kl_nats", "kl_sd_nats"))
        canvas.add_band(x, kl - sd, kl + sd, css)
        canvas.add_curve(x, kl, f"size {css}", code_words(card.effector))
        for size in sizes:
            text = f"{code_words(card.effector)}, {size.components}: {size.kl_nats:.4f} ± {size.kl_sd_nats:.4f} nats"
            if size.components == card.thesis_components:
                canvas.add_mark(size.components, size.kl_nats, f"{css} thesis", "ring", f"{text}, size of the thesis")
            if size.components == card.components:
                canvas.add_mark(size.components, size.kl_nats, css, shape, f"{text}, chosen")
    return canvas.with_caption(caption)


def drawing_of(reach: EffectorReach) -> dict[str, Any]:
    """JSON of the projections of one effector and of the volumes of its level sets, for the page's script."""
    return {
        "effector": reach.card.effector,
        "frame": reach.card.frame,
        "components": reach.card.components,
        "volumes_m3": {f"{level.mass:g}": level.volume_m3 for level in reach.level_sets},
        "maps": [each.model_dump(mode="json") for each in reach.projections],
    }


KIND: Final = "learn-reachability"
FILE: Final = "reachability.json"
IN_TABLE: Final = ("effectors.", "robot_sha256", "samples", "tried", "rejected_share", "learned_on")
CACHE_HEADERS: Final = {"Cache-Control": "private, max-age=600"}


def density_values(cards: Sequence[ProxyCard], address: str) -> dict[str, Any]:
    """Template values of densities (_reach.html); ``address`` is that of their maps."""
    return {
        "cards": cards,
        "charts": divergence_charts(cards),
        "legend": [
            *((*style_of(k), f"{code_words(card.effector)}: {card.components}") for k, card in enumerate(cards)),
            ("thesis", "ring", "the thesis"),
        ],
        "address": address,
        "terms": DENSITY_TERMS,
    }


async def learned_of(files: JobFiles, result: JobResult) -> dict[str, Any] | None:
    """Template values of the densities of a job; None for a result without their file."""
    if all(item.name != FILE for item in result.artifacts):
        return None
    content = await files.read_file(FILE)
    if content is None:
        return None
    learned = RobotReachability.model_validate_json(content)
    return density_values([each.card for each in learned.effectors], f"/jobs/{files.job_id}/reach.json")


def facts_beside_table(facts: Sequence[Fact]) -> list[Fact]:
    """Facts of a job that its table of densities does not contain."""
    return [fact for fact in facts if not fact.key.startswith(IN_TABLE)]


async def reach_json(request: Request) -> Response:
    """``GET /jobs/{id}/reach.json?effector=``: the maps of one effector."""
    client, job_id = client_of(request), request.path_params["id"]
    if all(item.name != FILE for item in (await client.result(job_id)).artifacts):
        raise HTTPException(404, "This job has learned no densities.")
    return maps_response(await _read_densities(client, job_id), request)


def maps_response(learned: RobotReachability, request: Request) -> Response:
    """The maps of the requested effector, or of the first one."""
    wanted = request.query_params.get("effector")
    for each in learned.effectors:
        if wanted in (None, each.card.effector):
            return JSONResponse(drawing_of(each), headers=CACHE_HEADERS)
    raise HTTPException(404, "Nothing was learned for this effector.")


async def _read_densities(client: AsyncClient, job_id: str) -> RobotReachability:
    return RobotReachability.model_validate_json(await client.read_artifact(job_id, FILE))
