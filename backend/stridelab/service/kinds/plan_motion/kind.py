"""The job kind ``plan-motion``."""

from typing import Final

from stridelab.schemas.plans import PlanMotionInput, PlanMotionSummary, PlanMotionTask
from stridelab.service.kinds.base import JobKind
from stridelab.service.kinds.staging import await_robot_links, stage_scenario
from stridelab.service.processes.sandbox import Sandbox
from stridelab.service.samples.scenario_bodies import ONE_STEP
from stridelab.service.samples.scenarios import EXAMPLE_ID

FILMING: Final = Sandbox(programs=True, server=True)
"""Sandbox of plans, which use ffmpeg and the local server of viser's recorder."""


KIND = JobKind(
    name="plan-motion",
    title="Motion plan",
    description="Plans the motion of a robot through a scenario: the path of its centre of mass with the contact "
    "forces, then the whole body with its certificate, then a replay in a physics simulation.",
    examples={
        "stored": {"summary": "Walk through a stored scenario", "value": {"scenario_id": EXAMPLE_ID}},
        "own": {
            "summary": "A scenario in the request, centroidal motion only",
            "value": {"scenario": ONE_STEP, "whole_body": False},
        },
    },
    input_model=PlanMotionInput,
    summary_model=PlanMotionSummary,
    stage=stage_scenario(PlanMotionTask),
    stage_later=await_robot_links,
    timeout_s=600.0,
    memory_mb=4096,
    lane="long",
    sandbox=FILMING,
    shows_parts=True,
)
