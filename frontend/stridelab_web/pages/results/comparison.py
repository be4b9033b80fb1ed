"""Comparison of estimators on the page of a job: its tables, and the figures to choose from."""

from typing import Any, Final

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from stridelab.schemas.comparison import CompareEstimatorsSummary
from stridelab.schemas.jobs import JobResult
from stridelab_web.api_client import client_of
from stridelab_web.pages.results.comparison_plots import FIGURES, STYLES
from stridelab_web.pages.results.comparison_tables import against_physics, against_truth
from stridelab_web.pages.results.quality import VERDICT_CODES
from stridelab_web.parquet import read_columns

KIND: Final = "compare-estimators"


def comparison_of(job_id: str, result: JobResult, chosen: str) -> dict[str, Any]:
    """Values for the template; ``chosen`` is the key of the figure to show, by default the first one."""
    summary = _ordered_summary(result)
    present = {item.name for item in result.artifacts}
    offered = {key: figure for key, figure in FIGURES.items() if figure.table in present}
    key = chosen if chosen in offered else next(iter(offered), None)
    return {
        "summary": summary,
        "tables": [
            table
            for table in (
                ("Against the truth", against_truth(summary)),
                ("Against physics", against_physics(summary)),
            )
            if table[1]
        ],
        "remarks": [
            *(("", remark) for remark in summary.warnings if remark.code not in VERDICT_CODES),
            *((name, remark) for name, one in summary.methods.items() for remark in one.warnings),
        ],
        "figures": [(name, figure.title, name == key) for name, figure in offered.items()],
        "figure": None if key is None else offered[key],
        "plots_url": f"/jobs/{job_id}/figures/{key}.json",
    }


async def figure_json(request: Request) -> Response:
    """``GET /jobs/{id}/figures/{name}.json``: the curves of one figure."""
    client, job_id = client_of(request), request.path_params["id"]
    view = FIGURES.get(request.path_params["name"])
    result = await client.result(job_id)
    if view is None or all(item.name != view.table for item in result.artifacts):
        raise HTTPException(404, "This job has no such figure.")
    summary = _ordered_summary(result)
    content = await client.read_artifact(job_id, view.table)
    drawn = await run_in_threadpool(lambda: view.draw(read_columns(content), summary))
    return JSONResponse(drawn, headers={"Cache-Control": "private, max-age=600"})


def _ordered_summary(result: JobResult) -> CompareEstimatorsSummary:
    """The summary with its methods in the order of the pages, unknown ones last."""
    summary = CompareEstimatorsSummary.model_validate(result.summary)
    rank = {name: place for place, name in enumerate(STYLES)}
    names = sorted(summary.methods, key=lambda name: (rank.get(name, len(rank)), name))
    return summary.model_copy(update={"methods": {name: summary.methods[name] for name in names}})
