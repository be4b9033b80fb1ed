"""Populations: the page of a study, and the form that starts one from chosen recordings."""

from typing import Any, Final

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from stridelab.schemas.jobs import JobResult
from stridelab.schemas.methods import METHODS
from stridelab.schemas.population import StudyPopulationSummary
from stridelab.schemas.recordings import Recording
from stridelab.translations.catalogue import ngettext
from stridelab_web.api_client import client_of, none_if_missing, took_s
from stridelab_web.pages.render import render_page
from stridelab_web.pages.results.cycloid_steps import PARAMETERS
from stridelab_web.pages.results.population_bars import bars_of
from stridelab_web.pages.results.population_charts import AGAINST, charts_against, groups_of
from stridelab_web.pages.results.population_tables import correlation_rows, model_rows, population_answer
from stridelab_web.pages.results.quality import shown_quality

KIND: Final = "study-population"
OFFERED: Final = 200
TABLES: Final = ("subjects", "steps", "correlations")
FORMATS: Final = (("csv", "CSV"), ("parquet", "Parquet"))


async def study_page(request: Request) -> Response:
    """``GET /population/{id}``."""
    client = client_of(request)
    job = await client.job(request.path_params["id"])
    if job.kind != KIND:
        return RedirectResponse(f"/jobs/{job.id}", status_code=303)
    result = await client.result(job.id) if job.state == "succeeded" else None
    return render_page(
        request,
        "pages/population.html",
        section="Population",
        job=job,
        took_s=took_s(job),
        result=result,
        quality=None if result is None else shown_quality(result.summary),
        study=None if result is None else _study_values(result, request.query_params.get("against", "")),
    )


async def new_study_page(request: Request) -> Response:
    """``GET /population``: recordings to choose from, with those of ``recording=`` chosen, and the studies so far.

    ``cursor=`` selects a later page of the recordings; the chosen ones are on every page.
    """
    requested = request.query_params.getlist("recording")
    client = client_of(request)
    studies = await client.jobs(kind=KIND)
    listed = await client.recordings(limit=OFFERED, cursor=request.query_params.get("cursor"))
    shown = {item.id: item for item in listed.items}
    for recording_id in dict.fromkeys(requested):
        if recording_id not in shown and (found := await none_if_missing(client.recording(recording_id))):
            shown[recording_id] = found
    chosen = set(requested)
    ordered = sorted(shown.values(), key=lambda item: item.id not in chosen)
    return render_page(
        request,
        "pages/population_new.html",
        section="Population",
        recordings=ordered,
        chosen=chosen,
        next=listed.next,
        people={item.id: _proposed_subject(item) for item in ordered},
        methods=METHODS,
        jobs=studies.items,
        more_jobs=studies.next is not None,
    )


def _study_values(result: JobResult, key: str) -> dict[str, Any]:
    summary = StudyPopulationSummary.model_validate(result.summary)
    subjects = summary.subjects
    offered = [a for a in AGAINST if any(getattr(subject, a.key) is not None for subject in subjects)]
    against = next((a for a in offered if a.key == key), offered[0] if offered else AGAINST[0])
    present = {item.name for item in result.artifacts}
    correlations = correlation_rows(summary)
    return {
        "summary": summary,
        "title": ngettext("Population of %(num)s subject", "Population of %(num)s subjects", len(subjects)),
        "parameters": PARAMETERS,
        "groups": list(groups_of(subjects).values()),
        "offered": offered,
        "against": against,
        "charts": charts_against(subjects, against),
        "figures": bars_of(subjects),
        "correlations": correlations,
        "answer": population_answer(summary, correlations),
        "models": model_rows(summary),
        "downloads": [
            (stem, [(text, f"{stem}.{end}") for end, text in FORMATS if f"{stem}.{end}" in present]) for stem in TABLES
        ],
    }


def _proposed_subject(recording: Recording) -> str:
    """Proposed subject: the pseudonym, else the file name, so that unknown subjects stay separate."""
    return recording.subject.name or recording.filename.rpartition(".")[0] or recording.filename
