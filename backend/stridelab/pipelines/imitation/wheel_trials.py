"""Does the person's rolling wheel help the robot? One scenario, planned without and with the wheel as reference."""

from typing import Any

import numpy as np

from stridelab.measures.walk_motion import UP
from stridelab.pipelines.imitation.comparison import Walker
from stridelab.pipelines.imitation.pace_search import Trial, try_walk
from stridelab.pipelines.imitation.wheel_reference import BRANCHES, RollingWheel, rolling_wheel, steady_spans
from stridelab.pipelines.plan_motion import MotionResult
from stridelab.pipelines.progress import ProgressCallback
from stridelab.schemas.imitation.contract import WheelTrial


def judge_wheel(person: Walker, best: Trial, progress: ProgressCallback) -> tuple[WheelTrial, ...]:
    """The plan of ``best`` and those with each wheel as reference; empty if no wheel fits the person's steps."""
    if not person.fits:
        return ()
    trials = [trial_of(best, None)]
    for index, branch in enumerate(BRANCHES):
        wheel = rolling_wheel(person.fits, branch)
        title = "thesis" if branch == 1 else "reversed"

        def tell(_fraction: float, text: str, share: float = index / len(BRANCHES), title: str = title) -> None:
            progress(share, f"with the {title} wheel as reference: {text}")

        body = best.scenario.model_dump(mode="json")
        trials.append(trial_of(try_walk(best.walk, body, best.attempt.pace, tell, wheel.change), wheel))
    return tuple(trials)


def trial_of(trial: Trial, wheel: RollingWheel | None) -> WheelTrial:
    """Costs of the plan and the motion, margins of the certificate, errors of the replay."""
    fields: dict[str, Any] = {}
    if wheel is not None and trial.result is not None:
        lengths_m = [length_m for _, _, length_m in steady_spans(trial.result.given)]
        fields |= {"r_m": wheel.ratio * float(np.mean(lengths_m)) / (2.0 * np.pi), "lowest_share": wheel.lowest_share}
    if trial.result is not None:
        fields |= _costs(trial.result)
        if trial.replay is not None:
            fields |= {name: getattr(trial.replay, name) for name in ("com_error_max_m", "com_error_rms_m")}
            fields["torque_ratio_max"] = trial.replay.torque_ratio_max
    return WheelTrial(
        wheel="none" if wheel is None else "thesis" if wheel.branch == 1 else "reversed",
        certified=trial.attempt.certified,
        completed=trial.attempt.completed,
        reason=trial.attempt.reason,
        **fields,
    )


def _costs(result: MotionResult) -> dict[str, float]:
    plan, motion = result.plan, result.motion
    spans = steady_spans(plan.sequence)
    steady = (plan.time_s >= spans[0][0]) & (plan.time_s <= spans[-1][1]) if spans else np.ones(len(plan.time_s), bool)
    costs = {"com_excursion_m": float(np.ptp(plan.com_m[steady, UP]))}
    if motion is None or result.stopped is not None:
        return costs
    acceleration = np.gradient(motion.com_v_reference_m_s, motion.time_s, axis=0)
    costs["acceleration_m2_s3"] = _integral(motion.time_s, acceleration**2)
    costs["torque_squared_nm2s"] = _integral(motion.time_s, motion.tau_nm**2)
    costs["joint_work_j"] = _integral(motion.time_s, np.abs(motion.tau_nm * motion.v[:, 6:]))
    if result.certificate is not None:
        values = {check.name: check.value for check in result.certificate.checks}
        costs["momentum_mismatch_nms"] = values["angular_momentum_mismatch_max"]
    return costs


def _integral(time_s: np.ndarray, values: np.ndarray) -> float:
    return float(np.trapezoid(values.sum(axis=1), time_s))
