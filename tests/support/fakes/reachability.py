"""The reach of the robot of boxes as the pages see it: an octahedron per level set, bells for projections."""

import math
from typing import Any

import numpy as np

from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.reachability import Axis, EffectorReach, LevelSurface, Projection, RobotReachability
from stridelab.schemas.robots import Frame, LinkPose, Measure, ProxyCard, ProxySize

MEASURES: tuple[Measure, ...] = ("uniform", "conditioned")
EFFECTORS = ("left_foot", "right_foot", "right_hand")
POSES: dict[str, LinkPose] = {
    "left_foot": (0.0, 0.09, 0.0, 1, 0, 0, 0),
    "right_foot": (0.0, -0.09, 0.0, 1, 0, 0, 0),
    "right_hand": (0.2, -0.3, 0.8, math.cos(0.4), math.sin(0.4), 0, 0),
}
"""Where the effectors' frames are in the reference posture."""
RADII_M = {0.5: 0.1, 0.8: 0.15, 0.95: 0.2}
MIDDLE_M = {"uniform": (0.0, 0.0, 0.7), "conditioned": (0.0, 0.0, 0.85)}
FACES = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
KIND, FILE = "learn-reachability", "reachability.json"


def frame_of(effector: str, measure: Measure) -> Frame:
    return "heading" if measure == "conditioned" and "hand" in effector else "contact"


def card(effector: str, measure: Measure) -> ProxyCard:
    """Six components where the thesis takes seven; divergences fall, and rise again from eight on."""
    sizes = [
        ProxySize(
            components=k, kl_nats=0.02 + 0.3 / k + 0.002 * max(0, k - 8), kl_sd_nats=0.004 + 0.02 / k,
            held_out_log_likelihood=2.0 - 0.3 / k,
        )
        for k in range(1, 21)
    ]  # fmt: skip
    return ProxyCard(
        effector=effector, measure=measure, frame=frame_of(effector, measure), components=6,
        thesis_components=14 if "hand" in effector else 7, samples=20_000, tried=32_000, rejected_share=0.375, seed=3,
        bandwidth_m=0.031, kl_nats=sizes[5].kl_nats, kl_sd_nats=sizes[5].kl_sd_nats,
        held_out_log_likelihood=1.95, mode_m=MIDDLE_M[measure], sizes=sizes, learned_on="2026-01-02",
        versions={"stridelab": "0.1.0", "scikit-learn": "1.9.0"},
    )  # fmt: skip


def reach(measure: Measure) -> RobotReachability:
    return RobotReachability(
        robot="boxes",
        robot_sha256="0" * 64,
        measure=measure,
        effectors=[
            EffectorReach(
                card=card(name, measure),
                reference_pose=(*POSES[name][:3], 1, 0, 0, 0) if frame_of(name, measure) == "heading" else POSES[name],
                com_m=[(x, y, z) for x, y, z in cloud(measure).tolist()],
                level_sets=[surface(mass, measure) for mass in RADII_M],
                projections=[projection("x", "y", "z"), projection("y", "x", "z"), projection("z", "x", "y")],
            )
            for name in EFFECTORS
        ],
    )


def cloud(measure: Measure) -> np.ndarray:
    return np.round(np.random.default_rng(1).normal(MIDDLE_M[measure], 0.08, (300, 3)), 3)


def surface(mass: float, measure: Measure) -> LevelSurface:
    r, (x, y, z) = RADII_M[mass], MIDDLE_M[measure]
    ends = [(x + r, y, z), (x - r, y, z), (x, y + r, z), (x, y - r, z), (x, y, z + r), (x, y, z - r)]
    return LevelSurface(
        mass=mass, density_per_m3=20.0 / mass, volume_m3=4 / 3 * r**3, vertices_m=ends, triangles=list(FACES)
    )


def projection(along: Axis, right: Axis, up: Axis) -> Projection:
    u, v = np.linspace(-0.5, 0.5, 21), np.linspace(0.2, 1.2, 21)
    bell = np.exp(-0.5 * (((u[None] / 0.15) ** 2) + ((v[:, None] - 0.7) / 0.1) ** 2))
    return Projection(
        along=along, right=right, up=up, right_m=u.round(4).tolist(), up_m=v.round(4).tolist(),
        kernel_per_m2=(5 * bell).tolist(), mixture_per_m2=(6 * bell).tolist(),
    )  # fmt: skip


def result(given: dict[str, Any]) -> JobResult:
    """Result of a job that learned anew."""
    content = job_file()
    summary = {
        "robot": "boxes", "robot_sha256": "0" * 64, "samples": 20_000, "tried": 32_000, "measure": "conditioned",
        "effectors": {}, "warnings": [],
    }  # fmt: skip
    return JobResult(
        kind=KIND, input=given, versions={}, references=[], summary=summary,
        artifacts=[Artifact(name=FILE, media_type="application/json", bytes=len(content))],
    )  # fmt: skip


def job_file() -> bytes:
    """``reachability.json`` of such a job."""
    return reach("conditioned").model_dump_json().encode()
