"""The viewer's pages for robots: a plan on its timeline, and a scenario with its contacts."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response

from stridelab.client import AsyncClient, ProblemError
from stridelab.schemas.jobs import FINAL_STATES, Job, JobResult
from stridelab.schemas.plans import CertificateCheck, PlanMotionSummary
from stridelab.schemas.scenarios import Scenario
from stridelab_web.api_client import client_of, none_if_missing
from stridelab_web.charts import intervals
from stridelab_web.charts.intervals import Bar, Layer, Row
from stridelab_web.formatting import check_name, code_words, count_text, with_unit
from stridelab_web.pages.render import render_page
from stridelab_web.pages.verdicts import shown_verdict
from stridelab_web.pages.viewer.preparing import preparation_page
from stridelab_web.scene.body_frames import PERSON
from stridelab_web.scene.contacts import contact_facts, effector_side, half_sizes, placed_contacts
from stridelab_web.scene.density_nodes import GROUP, SHOWN_MASS
from stridelab_web.scene.documents import Document
from stridelab_web.scene.frames import FORCE_SCALE, Frames
from stridelab_web.scene.plan_frames import GHOST, MEASURED, MOMENTUM, MOMENTUM_M_PER_NMS, ROBOT
from stridelab_web.scene.plan_frames import GROUP as CONES
from stridelab_web.scene.result_files import PERSON as PERSON_TABLE
from stridelab_web.scene.result_files import REPLAYED, SCENARIO, needed_files, read_plan

MARK_PERCENT: Final = 0.5
"""Width of a mark, in percent of the motion."""


@dataclass(frozen=True)
class Moment:
    """The time at which a check is worst; ``text`` has its value and place."""

    time_s: float
    text: str
    passed: bool


def moments_of(result: JobResult) -> list[Moment]:
    """Worst moments of all checks that have a time: failed checks first, then in the order of the certificate."""
    if result.kind != "plan-motion":
        return []
    certificate = PlanMotionSummary.model_validate(result.summary).certificate
    checks = certificate.checks if certificate is not None else []
    moments = [Moment(check.time_s, _moment_text(check), check.passed) for check in checks if check.time_s is not None]
    return sorted(moments, key=lambda moment: moment.passed)


def check_rows(moments: Sequence[Moment], duration_s: float) -> list[Row]:
    """One row of marks, failed checks last and on top; empty without moments."""
    if not moments or duration_s <= 0.0:
        return []
    bars = tuple(
        Bar(
            round(min(max(100 * moment.time_s / duration_s - MARK_PERCENT / 2, 0.0), 100.0 - MARK_PERCENT), 3),
            MARK_PERCENT,
            moment.text,
            "good" if moment.passed else "bad",
            moment.time_s,
        )
        for moment in reversed(moments)
    )
    failed = sum(not moment.passed for moment in moments)
    text = f"Worst moments of {count_text(len(moments), 'check')}, {failed} of them failed"
    return [Row("Checks", bars, text, "check")]


def _moment_text(check: CertificateCheck) -> str:
    where = f", {code_words(check.effector)}" if check.effector else ""
    verdict = "" if check.passed else "failed: "
    return f"{verdict}{check_name(check.name)} {with_unit(check.value, check.unit)}{where}, {check.time_s:.2f} s"


EXPORTS = {"motion.viser": ".viser", "motion.html": "HTML"}
"""Artifacts that play a plan without the service, with the texts of their links."""
KINDS = {"plan-motion": "/plans", "plan-receding": "/jobs", "imitate": "/jobs"}
"""Kinds of jobs whose result is a motion, with the base address of their pages."""


async def plan_page(request: Request, job_id: str) -> Response:
    """``GET /view/?plan=&t=``."""
    client = client_of(request)
    job = await client.job(job_id)
    if job.kind not in KINDS:
        raise HTTPException(404, "This job is not a plan.")
    if not job.has_result:
        return RedirectResponse(await _waiting_address(client, job), status_code=303)
    result = await client.result(job.id)
    scenario = Scenario.model_validate_json(await client.read_artifact(job.id, SCENARIO))
    if (waiting := await preparation_page(request, scenario.robot, scenario.name)) is not None:
        return waiting
    layers = [
        Layer("/forces/", "Forces", scale=FORCE_SCALE),
        Layer(CONES, "Cones", False, "Friction cones of the loaded contacts: forces must lie inside"),
        Layer("/contacts/", "Contacts"),
        Layer("/paths/", "Path"),
        Layer(MOMENTUM, "Angular momentum", False, f"About the centre of mass; {MOMENTUM_M_PER_NMS} m per N m s"),
    ]
    files = needed_files(result)
    if "poses.f32" in files:
        layers.insert(0, Layer(ROBOT, "Robot"))
    if REPLAYED[0] in files:
        differs = not result.summary["replay"]["completed"]
        layers.insert(1, Layer(GHOST, "Replay", differs, "The robot as it moved in physics, in blue"))
        layers.insert(3, Layer(MEASURED, "Measured forces", False, "Contact forces of the replay, in dark blue"))
    if PERSON_TABLE in files:
        said = "The person of the recording, scaled to the robot and on its clock"
        layers.insert(1, Layer(PERSON, "Person", True, said))
    if await _has_densities(client, scenario.robot):
        layers.append(Layer(GROUP, f"Reach, {100 * SHOWN_MASS:.0f} %", False))
    moments, scenario_s = moments_of(result), sum(phase.duration_s for phase in scenario.phases)
    links = [("Result", f"{KINDS[job.kind]}/{job.id}")]
    scenario_id = result.input.get("scenario_id")
    if scenario_id is not None and await none_if_missing(client.scenario(scenario_id)) is not None:
        links.append(("Scenario", f"/view/?scenario={scenario_id}"))
    return render_page(
        request,
        "viewer/view.html",
        section="Viewer",
        title=scenario.name,
        scene=Document("plan", job.id).address,
        start_s=0.0,
        rows=[*phase_rows(scenario, until_s(result)), *check_rows(moments, scenario_s)],
        moments=moments,
        layers=layers,
        uploads=False,
        bodies="poses.f32" in files,
        bands=False,
        links=links,
        verdict=shown_verdict(job, links[0][1], until_s(result)),
        steps=(),
        downloads=[
            (text, f"/api/v1/jobs/{job.id}/artifacts/{name}")
            for name, text in EXPORTS.items()
            if name in {item.name for item in result.artifacts}
        ],
    )


async def _waiting_address(client: AsyncClient, job: Job) -> str:
    """Page that shows a plan without a result: the editor of its scenario while it is computed, else its own page."""
    if job.state in FINAL_STATES:
        return f"{KINDS[job.kind]}/{job.id}"
    known = job.scenario_id is not None and await none_if_missing(client.scenario(job.scenario_id)) is not None
    if known and job.kind == "plan-motion":
        return f"/view/?scenario={job.scenario_id}&planning={job.id}"
    return f"{KINDS[job.kind]}/{job.id}?watch=1"


async def scenario_page(request: Request, scenario_id: str) -> Response:
    """``GET /view/?scenario=``."""
    client = client_of(request)
    stored = await client.scenario(scenario_id)
    if (waiting := await preparation_page(request, stored.robot, stored.name)) is not None:
        return waiting
    used = dict.fromkeys(touch.effector for touch in placed_contacts(stored))
    effectors = dict.fromkeys([*await _effector_names(client, stored.robot), *used])
    right = request.app.state.config.scenario_right(request.scope, stored.id, stored.owner)
    return render_page(
        request,
        "viewer/view_scenario.html",
        section="Viewer",
        scenario=stored,
        own=right.key is not None and not stored.bundled,
        refusal="" if stored.bundled else right.refusal,
        scene=Document("scenario", stored.id).address,
        duration_s=sum(phase.duration_s for phase in stored.phases),
        used=used,
        effectors=[(name, effector_side(name)) for name in effectors],
    )


async def contacts_json(request: Request) -> Response:
    """``GET /view/scene/scenario/{id}/-/touches.json``: the contacts as the page lists and moves them."""
    client = client_of(request)
    stored = await client.scenario(request.path_params["id"])
    sizes = half_sizes((await client.robot(stored.robot)).effectors)
    return JSONResponse([contact_facts(touch, sizes) for touch in placed_contacts(stored)])


async def load_frames(client: AsyncClient, job_id: str) -> Frames:
    """The frames of a plan."""
    result = await client.result(job_id)
    files = {name: await client.read_artifact(job_id, name) for name in needed_files(result)}
    _, plan_frames = await run_in_threadpool(lambda: read_plan(files))
    return plan_frames


def until_s(result: JobResult) -> float | None:
    """End of an incomplete motion in seconds; None for a complete one."""
    stopped = result.summary.get("stopped")
    return stopped["time_s"] if stopped else None


def phase_rows(scenario: Scenario, until_s: float | None = None) -> list[Row]:
    """Numbered phases and the contacts of each effector; an incomplete motion lasts ``until_s``."""
    placed = placed_contacts(scenario)
    duration_s = until_s or sum(phase.duration_s for phase in scenario.phases)
    ends_s = [0.0, *itertools.accumulate(phase.duration_s for phase in scenario.phases)]
    rows = [
        Row(
            "Phase",
            intervals.numbered_bars(itertools.pairwise(ends_s), duration_s),
            f"{count_text(len(scenario.phases), 'phase')}, counted from 0",
            "phase",
        )
    ]
    for effector in dict.fromkeys(touch.effector for touch in placed):
        bars = intervals.interval_bars([(t.start_s, t.end_s) for t in placed if t.effector == effector], duration_s)
        intervals_text = "; ".join(bar.text for bar in bars)
        rows.append(
            Row(
                code_words(effector).capitalize(),
                bars,
                f"{code_words(effector)} touches: {intervals_text}",
                effector_side(effector),
            )
        )
    return rows


async def _has_densities(client: AsyncClient, robot: str) -> bool:
    """Whether the robot has densities; False if it is no longer installed."""
    try:
        return bool((await client.robot(robot)).measures)
    except ProblemError:
        return False


async def _effector_names(client: AsyncClient, robot: str) -> list[str]:
    """Effectors of a robot; empty if it is not installed, so that its scenarios can still be viewed."""
    try:
        return [effector.name for effector in (await client.robot(robot)).effectors]
    except ProblemError:
        return []
