"""A finished imitation: a person beside a robot that walks level, and three plans, one of which is refused."""

import io
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stridelab.schemas.base import Remark
from stridelab.schemas.imitation.contract import ComparedQuantity, ImitateSummary, ImitationAttempt, WheelTrial
from stridelab.schemas.plans import CertificateSummary, ReplaySummary
from stridelab.schemas.quality import Quality
from support.fakes import robots

KIND = "imitate"


def imitation_result() -> tuple[dict[str, Any], dict[str, bytes]]:
    """Summary and files."""
    scenario = robots.scenario()
    replay = ReplaySummary(
        completed=True, com_error_rms_m=0.0016, com_error_max_m=0.0033, foot_slip_max_m=0.001,
        landing_error_max_m=0.002, torque_ratio_max=0.7, real_time_factor=4.0, remarks=[],
    )  # fmt: skip
    attempt = {"pace": 0.6, "step_length_m": 0.5, "speed_m_s": 0.4, "completed": True, "certified": True, "reason": ""}
    failed = attempt | {"step_share": 1.0, "certified": False, "completed": False, "reason": "certificate: <self> 3"}
    rows = [
        ("com_height", "m", 0.93, 0.82, 0.84, 2, 3),
        ("walking_speed", "m/s", 1.16, 1.11, 0.53, 2, 3),
        ("double_support_share", "1", 0.21, 0.21, 0.2, 2, 3),
        ("wheel_r", "m", 0.014, 0.012, None, 2, 0),
    ]
    names = ("name", "unit", "person", "scaled", "robot", "n_person", "n_robot")
    costs = {"com_excursion_m": 0.005, "acceleration_m2_s3": 1.7, "torque_squared_nm2s": 179000.0}
    summary = ImitateSummary(
        scenario=scenario,
        certificate=CertificateSummary(passed=True, checks=[]),
        replay=replay,
        comparison=[ComparedQuantity(**dict(zip(names, row, strict=True))) for row in rows],
        robot="boxes", filename="<i>walk</i>.c3d", step_share=0.8, pace=0.6, speed_share=0.47, length_scale=0.9,
        time_scale=0.95, hip_height_person_m=0.83, hip_height_robot_m=0.75, widened_m=0.088, recorded_footholds=5,
        repeated_footholds=1,
        attempts=[ImitationAttempt(**failed), ImitationAttempt(**attempt, step_share=0.8)],
        wheel=[
            WheelTrial(wheel="none", certified=True, completed=True, reason="", **costs),
            WheelTrial(wheel="thesis", certified=True, completed=True, reason="", r_m=0.004, **costs),
            WheelTrial(wheel="reversed", certified=False, completed=False, reason="certificate: contact drift"),
        ],
        plan=robots.plan_summary(whole_body=True),
        quality=Quality(verdict="good", checks=[], not_checked={}),
        warnings=[Remark(code="stride-repeated", message="The last stride is repeated.")],
    )  # fmt: skip
    share = np.linspace(0.0, 1.0, 11)
    columns = {"step_share": share}
    for who, size in (("person", 0.01), ("robot", 0.002)):
        for name in ("com_height_m", "com_sideways_m", "com_speed_m_s", "margin_m"):
            columns[f"{who}_{name}"] = np.where(share > 0.8, np.nan, size * np.cos(2.0 * np.pi * share))
    file = io.BytesIO()
    pq.write_table(pa.table(columns), file)
    return summary.model_dump(mode="json"), robots.plan_files(scenario, replay=True) | {
        "curves.parquet": file.getvalue()
    }
