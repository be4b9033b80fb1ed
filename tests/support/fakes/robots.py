"""The robot wing as the pages see it, answered from memory: a robot of boxes climbs two steps along known curves.

The right foot's link is the one that tests look at: ``foot_pose`` says where it is at any time.
"""

import io
import itertools
import json
import math
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import trimesh

from stridelab.schemas.base import FaultItem, Remark
from stridelab.schemas.jobs import Artifact, JobResult
from stridelab.schemas.plans import (
    AgreementPass,
    CertificateCheck,
    CertificateSummary,
    CostWeights,
    PlanMotionSummary,
    PlanVerification,
    ReplaySummary,
)
from stridelab.schemas.receding import PlanRecedingSummary
from stridelab.schemas.robots import (
    LinkPose,
    Measure,
    RobotEffector,
    RobotFacts,
    RobotPreparation,
    RobotSummary,
)
from stridelab.schemas.scenarios import (
    BoxSurface,
    ContactMargin,
    PhaseBody,
    PhaseSupport,
    RailSurface,
    Scenario,
    ScenarioCheck,
    ScenarioContact,
    ScenarioPhase,
    StoredScenario,
)
from support.fakes import reachability

LINKS = ("base_link", "leg_left_6_link", "leg_right_6_link", "arm_right_7_link", "bare_link")
REFERENCE: list[LinkPose] = [
    (0.0, 0.0, 0.9, 1, 0, 0, 0), (0.0, 0.09, 0.05, 1, 0, 0, 0), (0.0, -0.09, 0.05, 1, 0, 0, 0),
    (0.0, -0.3, 0.8, 1, 0, 0, 0), (0.0, 0.0, 1.2, 1, 0, 0, 0),
]  # fmt: skip
"""Where the links are in the reference posture, in the order of ``LINKS``."""
EFFECTORS = reachability.EFFECTORS
FRICTION = {effector: 0.3 if "foot" in effector else 0.7 for effector in EFFECTORS}
HALF_M = (0.10, 0.06)
DISPLAY_HZ, NODES_HZ = 50.0, 20.0
REFUSED_BEYOND_M = 0.4
"""The fake judge refuses every foot that stands farther to the side."""
COST_TERMS = {
    "point_force": 0.75, "log_density_right_foot": -11.0, "com_acceleration": 4.0, "surface_force": 1.5,
    "log_density_left_foot": -9.467, "momentum_rate": 2.0,
}  # fmt: skip
WEIGHTS = CostWeights(com_acceleration=10, momentum_rate=10, likelihood=1, surface_force=1, point_force=300)
PASSES = [
    AgreementPass(mismatch_max_nms=7.5, mismatch_rms_nms=2.5, solve_time_s=0.003),
    AgreementPass(mismatch_max_nms=0.75, mismatch_rms_nms=0.25, solve_time_s=0.004),
]
_NOW = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)


READY = RobotPreparation(state="ready", fraction=1.0, message="ready")


def scenario(name: str = "Two steps", robot: str = "boxes") -> Scenario:
    """Feet side by side, right then left foot onto a step of 0.1 m, then onto the next; the right hand on a rail."""
    rail = ScenarioContact(effector="right_hand", position_m=(0.2, -0.5, 0.92))
    phases: list[ScenarioPhase] = []

    def phase(duration_s: float, *contacts: ScenarioContact) -> None:
        phases.append(ScenarioPhase(duration_s=duration_s, contacts=list(contacts)))

    def foot(side: str, k: int) -> ScenarioContact:
        y = 0.09 if side == "left" else -0.09
        return ScenarioContact(effector=f"{side}_foot", position_m=(0.3 * k, y, 0.1 * k))

    phase(1.0, foot("left", 0), foot("right", 0))
    for k in (1, 2):
        phase(0.8, foot("left", k - 1), rail)
        phase(0.2, foot("left", k - 1), foot("right", k), rail)
        phase(0.8, foot("right", k), rail)
        phase(0.2 if k == 1 else 1.0, foot("left", k), foot("right", k), rail)
    return Scenario(
        name=name,
        description="",
        robot=robot,
        friction=0.3,
        terrain=[
            BoxSurface(name="ground", kind="box", center_m=(0.5, 0.0, -0.05), size_m=(6.0, 6.0, 0.1)),
            # the lower step runs on below the upper one
            BoxSurface(name="step 1", kind="box", center_m=(0.745, 0.0, 0.05), size_m=(1.2, 1.2, 0.1)),
            BoxSurface(name="step 2", kind="box", center_m=(0.895, 0.0, 0.1), size_m=(0.9, 1.2, 0.2)),
            RailSurface(name="rail", kind="rail", from_m=(-0.2, -0.5, 0.9), to_m=(1.4, -0.5, 0.9), radius_m=0.02),
        ],
        phases=phases,
    )


def duration_s(given: Scenario) -> float:
    return sum(phase.duration_s for phase in given.phases)


def foot_pose(time_s: np.ndarray) -> np.ndarray:
    """Pose ``(n, 7)`` of ``leg_right_6_link``: along a parabola, turning half about the vertical, w both signs."""
    half = math.pi * time_s / 10
    zero = np.zeros_like(time_s)
    position = [0.12 * time_s, -0.09 + 0.01 * time_s, 0.05 + 0.004 * time_s**2]
    sign = np.where(np.arange(len(time_s)) % 2 == 0, 1.0, -1.0)  # q and -q are the same: frames alternate
    return np.column_stack([*position, sign * np.cos(half), zero, zero, sign * np.sin(half)])


def links_glb() -> bytes:
    """A box per link, each in its link's frame; the last link has none."""
    scene = trimesh.Scene()
    sizes = {"base_link": (0.3, 0.4, 0.8), "leg_left_6_link": (0.2, 0.12, 0.1), "leg_right_6_link": (0.2, 0.12, 0.1),
             "arm_right_7_link": (0.08, 0.08, 0.3)}  # fmt: skip
    for name, size in sizes.items():
        box = trimesh.creation.box(size)
        box.visual.vertex_colors = [200, 205, 210, 255]
        scene.add_geometry(box, node_name=name, geom_name=name)
    return bytes(scene.export(file_type="glb"))


def display_times_s(given: Scenario) -> np.ndarray:
    return np.arange(round(duration_s(given) * DISPLAY_HZ) + 1) / DISPLAY_HZ


def poses(given: Scenario) -> np.ndarray:
    """``poses.f32`` as an array ``(frames, links, 7)``."""
    t = display_times_s(given)
    array = np.zeros((len(t), len(LINKS), 7), dtype="<f4")
    array[:, :, 3] = 1.0
    array[:, 0, :3] = np.column_stack([0.1 * t, 0 * t, 0.9 + 0.02 * t])
    array[:, 1, :3] = np.column_stack([0.1 * t, 0 * t + 0.09, 0.05 + 0.03 * t])
    array[:, 2] = foot_pose(t)
    array[:, 3, :3] = np.column_stack([0.2 + 0.1 * t, 0 * t - 0.5, 0 * t + 1.05])
    return array


def forces(given: Scenario) -> np.ndarray:
    """``forces.f32`` as an array ``(frames, effectors, 6)``, NaN where nothing touches."""
    t = display_times_s(given)
    array = np.full((len(t), len(EFFECTORS), 6), np.nan, dtype="<f4")
    start_s = 0.0
    for phase in given.phases:
        there = (t >= start_s - 1e-9) & (t < start_s + phase.duration_s - 1e-9)
        start_s += phase.duration_s
        for contact in phase.contacts:
            k = EFFECTORS.index(contact.effector)
            array[there, k, :3] = contact.position_m
            array[there, k, 3:] = (5.0, 0.0, 20.0) if contact.effector == "right_hand" else (10.0, -5.0, 400.0)
    return array


def centroidal(given: Scenario) -> dict[str, np.ndarray]:
    """Columns of ``centroidal.parquet``: the CoM speeds up and slows down by a constant each half of the way."""
    t = np.arange(round(duration_s(given) * NODES_HZ) + 1) / NODES_HZ
    half = duration_s(given) / 2
    a = 0.04
    x = np.where(t <= half, a * t**2 / 2, a * half**2 - a * (2 * half - t) ** 2 / 2)
    v = np.where(t <= half, a * t, a * (2 * half - t))
    ends = np.array(list(itertools.accumulate(phase.duration_s for phase in given.phases)))
    zero = np.zeros_like(t)
    columns = {
        "time_s": t,
        "phase": np.minimum(np.searchsorted(ends, t + 1e-9, side="right"), len(ends) - 1).astype(float),
        "com_x_m": x, "com_y_m": zero, "com_z_m": zero + 0.88,
        "com_vx_m_s": v, "com_vy_m_s": zero, "com_vz_m_s": zero,
        "com_ax_m_s2": np.where(t < half, a, -a), "com_ay_m_s2": zero, "com_az_m_s2": zero,
    }  # fmt: skip
    for effector in EFFECTORS:
        for k in range(1 if effector == "right_hand" else 4):
            columns |= {f"f_{effector}_{k}_{axis}_n": zero + (100.0 if axis == "z" else 0.0) for axis in "xyz"}
    touching = [{contact.effector for contact in phase.contacts} for phase in given.phases]
    for effector in EFFECTORS:
        there = np.array([effector in touching[int(k)] for k in columns["phase"]])
        columns[f"friction_{effector}"] = np.where(there, FRICTION[effector], 0.0)
    return columns | {"l_x_nms": zero, "l_y_nms": np.sin(t), "l_z_nms": zero}


def replay_table(given: Scenario) -> dict[str, np.ndarray]:
    """Columns of ``replay.parquet``: the left foot bears 300 N until a fall at 3 s."""
    t = np.arange(1, round(3.0 * 250.0) + 1) / 250.0
    columns = {"time_s": t, "com_x_m": 0.01 * t, "com_y_m": 0 * t, "com_z_m": 0 * t + 0.87}
    for effector in EFFECTORS:
        columns |= {f"f_{effector}_{axis}_n": 0 * t + 300.0 * (effector == "left_foot") for axis in "xyz"}
    return columns


def replayed(given: Scenario) -> dict[str, bytes]:
    """Files of a replay 10 mm above the plan, which ends in a fall at 3 s."""
    fallen = display_times_s(given) > 3.0
    above = poses(given)
    above[:, :, 2] += 0.01
    above[fallen] = np.nan
    measured = forces(given)
    measured[fallen] = np.nan
    sink = io.BytesIO()
    pq.write_table(pa.table(replay_table(given)), sink)
    return {
        "replay_poses.f32": above.tobytes(),
        "replay_forces.f32": measured.tobytes(),
        "replay.parquet": sink.getvalue(),
    }


def plan_files(given: Scenario, *, whole_body: bool = True, replay: bool = False) -> dict[str, bytes]:
    """All files of a plan."""
    sink = io.BytesIO()
    pq.write_table(pa.table(centroidal(given)), sink)
    bare = Scenario(**{name: getattr(given, name) for name in Scenario.model_fields})
    contents = {"scenario.json": bare.model_dump_json().encode(), "centroidal.parquet": sink.getvalue()}
    if whole_body:
        about = {
            "robot": given.robot,
            "n_frames": len(display_times_s(given)),
            "time_s": [round(float(t), 6) for t in display_times_s(given)],
            "links": list(LINKS),
            "forces": {"file": "forces.f32", "effectors": list(EFFECTORS)},
        }
        contents |= {
            "poses.json": json.dumps(about).encode(),
            "poses.f32": poses(given).tobytes(),
            "forces.f32": forces(given).tobytes(),
        }
    return contents | (replayed(given) if replay else {})


def plan_result(given: dict[str, Any], files: dict[str, bytes]) -> JobResult:
    """Result of a plan with these files."""
    artifacts = [Artifact(name=n, media_type="application/octet-stream", bytes=len(c)) for n, c in files.items()]
    return JobResult(
        kind="plan-motion",
        input=given,
        versions={},
        references=[],
        summary=plan_summary(whole_body="poses.json" in files).model_dump(mode="json")
        | {"formulation": given.get("formulation", "forces")},
        artifacts=artifacts,
    )


def plan_summary(*, whole_body: bool) -> PlanMotionSummary:
    """One check passed and one failed; the replay falls."""
    checks = [
        CertificateCheck(
            name="com_error_max", value=0.000155, unit="m", limit=0.001, at_least=False, passed=True, phase=3,
            time_s=2.5,
        ),
        CertificateCheck(
            name="terrain_distance_min", value=-0.0123, unit="m", limit=0.0, at_least=True, passed=False, phase=1,
            effector="leg_left_4_link", time_s=1.25,
        ),
    ]  # fmt: skip
    replay = ReplaySummary(
        completed=False, fall_time_s=3.21, com_error_rms_m=0.1, com_error_max_m=0.25, foot_slip_max_m=0.0042,
        landing_error_max_m=0.0071, hand_force_mean_n=6.4, torque_ratio_max=0.73, real_time_factor=5.0,
    )  # fmt: skip
    return PlanMotionSummary(
        scenario_name="Two steps", robot="boxes", duration_s=5.0, n_phases=9, converged=True, solver="ipopt",
        objective=-14.467, cost_terms=COST_TERMS, weights=WEIGHTS, formulation="forces",
        measure="conditioned", node_rate_hz=10.0, kkt_error=3.2e-7, iterations=18, solve_time_s=0.55, build_time_s=0.32,
        verification=PlanVerification(dynamics_gap=0, terminal_gap=0, cone_margin_n=1, normal_force_min_n=1),
        stage_times_s={"export": 1.0, "check": 0.5, "centroidal": 2.5},
        certificate=CertificateSummary(passed=False, checks=checks) if whole_body else None,
        replay=replay if whole_body else None,
        agreement=PASSES if whole_body else [],
        warnings=[Remark(code="replay-fell", message="Replayed in physics, the robot falls.")],
    )  # fmt: skip


def receding_columns(replans: int = 40, period_s: float = 0.1) -> dict[str, np.ndarray]:
    """``receding.parquet``: one replan in four is late, and the last of all found nothing."""
    t = period_s * np.arange(replans + 1)
    zero = np.zeros_like(t)
    took_ms = np.where(np.arange(replans) % 4 == 0, 120.0, 40.0)
    return {
        "time_s": t,
        "com_x_m": 0.1 * t, "com_y_m": np.sin(t), "com_z_m": zero + 0.88,
        "com_vx_m_s": zero + 0.1, "com_vy_m_s": np.cos(t), "com_vz_m_s": zero,
        "l_x_nms": zero, "l_y_nms": zero, "l_z_nms": zero,
        "replan_ms": np.append(took_ms, np.nan),
        "iterations": np.append(np.full(replans, 9.0), np.nan),
        "carried_on": np.concatenate([np.zeros(replans - 1), [1.0, np.nan]]),
    }  # fmt: skip


def receding_result(given: dict[str, Any], files: dict[str, bytes]) -> JobResult:
    """Result of a receding horizon with these files."""
    summary = PlanRecedingSummary(
        scenario_name="Two steps", robot="boxes", duration_s=5.0, solver="ipopt", replans=40, carried_on=1,
        iterations_median=9.0, iterations_max=9, replan_median_ms=40.0, replan_p99_ms=120.0, replan_max_ms=120.0,
        goal_gap_m=1e-19, warnings=[],
    )  # fmt: skip
    artifacts = [Artifact(name=n, media_type="application/octet-stream", bytes=len(c)) for n, c in files.items()]
    return JobResult(
        kind="plan-receding", input=given, versions={}, references=[], summary=summary.model_dump(mode="json"),
        artifacts=artifacts,
    )  # fmt: skip


def receding_files() -> dict[str, bytes]:
    """All files of a receding horizon."""
    sink = io.BytesIO()
    pq.write_table(pa.table(receding_columns()), sink)
    return plan_files(scenario(), whole_body=False) | {"receding.parquet": sink.getvalue()}


def stored(given: Scenario, *, bundled: bool = False, key: str | None = None) -> StoredScenario:
    """``given`` as the service keeps it."""
    about = {"id": key or uuid.uuid4().hex, "created_at": _NOW, "updated_at": datetime.now(UTC), "bundled": bundled}
    return StoredScenario(**{**given.model_dump(), **about})


def robot(measures: Sequence[Measure] = reachability.MEASURES, stale: Sequence[Measure] = ()) -> RobotFacts:
    """The robot of boxes."""
    effectors = [
        RobotEffector(
            name=name, frame=name, kind="point" if "hand" in name else "surface", position_m=(0, 0, 0),
            orientation_wxyz=(1, 0, 0, 0), contact_half_size_m=None if "hand" in name else HALF_M,
        )
        for name in EFFECTORS
    ]  # fmt: skip
    return RobotFacts(
        name="boxes", title="Boxes", mass_kg=60.0, licence="BSD-3-Clause", sha256="0" * 64, effectors=effectors,
        q_reference=[], com_height_m=0.88, limits=[], links=list(LINKS), link_poses=REFERENCE,
        proxies=[reachability.card(name, measure) for measure in measures for name in EFFECTORS],
        measures=list(measures), stale_measures=list(stale), default_measure="uniform",
    )  # fmt: skip


def robots(reason: str | None = None) -> list[RobotSummary]:
    """The robot of boxes, and one whose data is not installed; with a ``reason``, neither is."""
    known = {"licence": "BSD-3-Clause", "effectors": list(EFFECTORS)}
    absent = "The package <rare> is not installed."
    return [
        RobotSummary(name="boxes", title="Boxes", available=reason is None, reason=reason, **known),
        RobotSummary(name="rare", title="Rare", available=False, reason=absent, **known),
    ]


def refusal(given: Scenario) -> list[tuple[str, str]]:
    """Problem body with the faults of the fake validation."""
    return [
        (f"phases[{k}].contacts[{contact.effector}]", "The foot stands on nothing.")
        for k, phase in enumerate(given.phases)
        for contact in phase.contacts
        if "foot" in contact.effector and abs(contact.position_m[1]) > REFUSED_BEYOND_M
    ]


def support(k: int, phase: ScenarioPhase) -> PhaseSupport:
    """Support of a phase by the fake validation: not at rest on the right foot alone."""
    feet = [contact for contact in phase.contacts if "foot" in contact.effector]
    alone = [foot.effector for foot in feet] == ["right_foot"]
    x, y, z = feet[0].position_m
    return PhaseSupport(phase=k, margin_m=-0.02 if alone else 0.06, com_m=(x, y, z + 0.9))


def region(phase: ScenarioPhase) -> list[tuple[float, float]]:
    """A rectangle around the first foot."""
    x, y, _ = next(contact.position_m for contact in phase.contacts if "foot" in contact.effector)
    return [(x + u * HALF_M[0], y + v * HALF_M[1]) for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def check(given: Scenario) -> ScenarioCheck:
    """Answer of the fake validation."""
    wrong = refusal(given)
    margins = [
        ContactMargin(phase=k, effector=c.effector, surface="ground", height_m=0.0, edge_m=0.04, reach_m=0.25)
        for k, phase in enumerate(given.phases)
        for c in phase.contacts
    ]
    return ScenarioCheck(
        valid=not wrong,
        errors=[FaultItem(where=where, message=message) for where, message in wrong],
        warnings=[Remark(code="swing-obstructed", message="The right foot passes through step 1.")],
        margins=margins,
        support_region_m=[region(phase) for phase in given.phases],
        support=[support(k, phase) for k, phase in enumerate(given.phases)],
        phases=[PhaseBody(phase=k, body="reachable") for k in range(len(given.phases))],
        duration_s=duration_s(given),
    )
