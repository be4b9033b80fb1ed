"""The page of one recording: its facts, newest estimate and settings, and the form that starts an estimate."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from starlette.requests import Request
from starlette.responses import Response

from stridelab.client import AsyncClient
from stridelab.schemas.jobs import EstimateComInput
from stridelab.schemas.methods import METHODS
from stridelab.schemas.recordings import Recording
from stridelab_web.api_client import client_of
from stridelab_web.assets import plotly_style_ids
from stridelab_web.charts import intervals
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results.measures import newest_gait
from stridelab_web.pages.results.summary_facts import headline_of

LATENCIES = (
    ("report", "estimate and report"),
    ("apply", "estimate and correct"),
    ("number", "correct by a number…"),
)
TABLES = (
    ("auto", "chosen by sex and marker set"),
    ("dumas2007", "Dumas 2007"),
    ("deleva1996", "de Leva 1996"),
    ("carried", "carried by the file"),
)
CANDIDATES = 100
GEOMETRY = "geometry"
DELETED_SET = "marker-set-deleted"
"""Code of the warning of a recording whose marker set has been deleted."""
PROPOSED_SET = "proposed"
"""Marker set of a recording whose markers are named by likeness and place, to be checked."""


async def recording_page(request: Request) -> Response:
    """``GET /recordings/{id}``; with ``known`` the page says that an uploaded file was stored already."""
    client = client_of(request)
    recording = await client.recording(request.path_params["id"])
    jobs = await client.jobs(recording_id=recording.id)
    others = [item for item in (await client.recordings(limit=CANDIDATES)).items if item.id != recording.id]
    session = await _session_of(client, recording)
    person = None if recording.subject_id is None else await client.subject(recording.subject_id)
    gait = await newest_gait(client, [recording.id], jobs.items)
    estimated = next((job for job in jobs.items if job.kind == "estimate-com" and job.state == "succeeded"), None)
    result = await client.result(estimated.id) if estimated else None
    alternatives = {name for group in recording.missing_landmarks for name in group.split("|")}
    return render_page(
        request,
        "pages/recording.html",
        section="Recordings",
        recording=recording,
        known="known" in request.query_params,
        person=person,
        jobs=jobs.items,
        gait=gait,
        job=estimated,
        headline=headline_of(result) if result else None,
        plots=estimated is not None,
        plots_url=f"/jobs/{estimated.id}/plots.json" if estimated else None,
        plotly_style_ids=plotly_style_ids() if estimated else (),
        viewer_url=f"/view/?recording={recording.id}&job={estimated.id}" if estimated else None,
        others=others,
        session=session,
        labels=list(
            dict.fromkeys([*recording.labels, *(label for item in session if item.still for label in item.labels)])
        ),
        walks=[item.id for item in session if not item.still],
        comparable=comparable_groups(recording, others),
        standing=[item for item in session if item.still and item.id != recording.id],
        windows=intervals.interval_bars(recording.windows_s, recording.duration_s),
        windows_text=intervals.windows_text(recording),
        plate_bars=[intervals.plate_bars(plate, recording.duration_s) for plate in recording.plates],
        ticks=intervals.time_ticks(recording.duration_s),
        unnamed=recording.marker_set in (None, PROPOSED_SET)
        or any(item.code == DELETED_SET for item in recording.warnings),
        mappable=sorted({*recording.landmarks, *alternatives, *recording.marker_map}),
        methods=METHODS,
        method=_default_method(recording),
        refused=_refused_methods(recording),
        latencies=LATENCIES,
        latency=EstimateComInput.model_fields["latency"].default,
        tables=TABLES,
        robots=[robot for robot in (await client.robots()).items if robot.available],
    )


@dataclass(frozen=True)
class ComparableGroup:
    """Recordings of one person and day, or one of a person who is not known, that a report may compare with."""

    name: str
    day: datetime
    recording_ids: tuple[str, ...]

    @property
    def joined_ids(self) -> str:
        """The ids with spaces between them."""
        return " ".join(self.recording_ids)


def comparable_groups(recording: Recording, others: Sequence[Recording]) -> tuple[ComparableGroup, ...]:
    """The walks of ``others`` by session, without those of the session of ``recording``; the newest first."""
    groups: dict[str, list[Recording]] = {}
    for other in others:
        if not other.still and (other.session_id is None or other.session_id != recording.session_id):
            groups.setdefault(other.session_id or other.id, []).append(other)
    return tuple(
        ComparableGroup(
            name=next((walk.subject.name for walk in walks if walk.subject.name), walks[0].filename),
            day=max(walk.created_at for walk in walks),
            recording_ids=tuple(sorted(walk.id for walk in walks)),
        )
        for walks in groups.values()
    )


def _refused_methods(recording: Recording) -> dict[str, str]:
    """Methods that refuse the recording, with their reason; "" stands for the best available method.

    The best available method fuses force with markers; it is refused if every such method is.
    """
    refused: dict[str, str] = {offer.method: offer.reason or "" for offer in recording.estimates if not offer.possible}
    with_force = [offer.method for offer in recording.estimates if offer.method != GEOMETRY]
    if with_force and all(method in refused for method in with_force):
        return {"": refused[with_force[0]], **refused}
    return refused


def _default_method(recording: Recording) -> str:
    """The default method: the best available, or markers only if nothing else is possible."""
    refused = _refused_methods(recording)
    return GEOMETRY if "" in refused and GEOMETRY not in refused else ""


async def _session_of(client: AsyncClient, recording: Recording) -> list[Recording]:
    """All trials of the recording's session, including itself, sorted by name."""
    if recording.session_id is None:
        return []
    listed = (await client.recordings(limit=CANDIDATES, session_id=recording.session_id)).items
    return sorted((item for item in listed if item.owner == recording.owner), key=lambda item: (item.filename, item.id))
