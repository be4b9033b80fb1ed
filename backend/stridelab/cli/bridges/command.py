"""``stridelab bridge``: markers of a motion-capture system to the live balance of a service."""

import asyncio
from contextlib import aclosing
from typing import Annotated, Final

import typer
from rich.markup import escape

from stridelab.cli.options import Height, Mass, PersonSex, Token
from stridelab.cli.results import out
from stridelab.schemas.streams import FrameEstimate, MarkerPerson, MarkerStreamConfiguration

SHOWN_FRAMES: Final = 100
"""Frames between two printed margins."""


def bridge(
    source: Annotated[str, typer.Argument(help="qualisys://HOST[:PORT] or vicon://HOST[:PORT].")],
    *,
    height: Height = None,
    mass: Mass = None,
    sex: PersonSex = None,
    title: Annotated[str, typer.Option("--title", help="Shown where streams are listed.")] = "",
    frames: Annotated[int | None, typer.Option("--frames", min=1, help="Stop after so many frames.")] = None,
    server: Annotated[str, typer.Option("--server", help="URL of the service.")] = "http://127.0.0.1:8000",
    token: Token = None,
) -> None:
    """Send the markers of a motion-capture system to a service, which shows the person on its page /live."""
    from stridelab.cli.remote import translated_errors

    person = MarkerPerson(mass_kg=mass, height_m=height, sex=sex)
    with translated_errors(server):
        count, without = asyncio.run(forward_markers(source, person, title, frames, server, token))
    out.print(f"{count} frames, {without} of them without an estimate")


async def forward_markers(
    source: str, person: MarkerPerson, title: str, most_frames: int | None, server: str, token: str | None
) -> tuple[int, int]:
    """Forward frames until the system ends or ``most_frames`` are answered: how many, and how many without an estimate.

    Raises the errors of ``open_source``, and ``ClientError`` where the service refuses the markers.
    """
    from stridelab.cli.bridges.sources import open_source
    from stridelab.client import AsyncClient

    count = without = 0
    async with open_source(source) as live:
        header = MarkerStreamConfiguration(
            labels=live.labels,
            rate_hz=live.rate_hz,
            units="mm",
            up_axis=live.up_axis,
            person=person,
            title=title or source[:80],
        )
        async with AsyncClient(server, token) as lab, lab.stream_markers(header) as opened:
            known = escape(opened.ready.marker_set)
            out.print(f"{len(live.labels)} markers at {live.rate_hz:g} Hz, marker set {known}")
            for remark in opened.ready.remarks:
                out.print(f"[yellow]{escape(remark.message)}[/]")
            async with aclosing(opened.follow(live.frames)) as estimates:
                async for estimate in estimates:
                    count += 1
                    without += estimate.com_m is None
                    if count % SHOWN_FRAMES == 0:
                        out.print(_describe_estimate(estimate))
                    if count == most_frames:
                        break
    return count, without


def _describe_estimate(estimate: FrameEstimate) -> str:
    margin = estimate.margin_m
    if margin is None:
        return f"{estimate.t_s:.2f} s: no margin ({estimate.margin_reason})"
    return f"{estimate.t_s:.2f} s: {100.0 * margin.ap:+.1f} cm ahead, {100.0 * margin.ml:+.1f} cm sideways"
