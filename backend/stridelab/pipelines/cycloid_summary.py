"""Summary of ``fit-cycloid``: converts the fits to the response schema."""

from collections.abc import Sequence

import numpy as np

from stridelab.conventions import Series, Vector3
from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.quality import Quality
from stridelab.pipelines.com_inputs import ComInputs
from stridelab.pipelines.estimate_com import summary_fields
from stridelab.recordings.recording import Remark
from stridelab.schemas import cycloid as contract
from stridelab.walking.path_fit import PathFit
from stridelab.walking.step_fit import StepFit
from stridelab.walking.step_variability import Overlap, Scatter
from stridelab.walking.steps import GaitStep
from stridelab.walking.timed_fit import TimedFit

MM = 1e3


def cycloid_summary(
    prepared: ComInputs,
    estimate: ComEstimate,
    quality: Quality,
    walking_direction: Vector3,
    all_steps: Sequence[GaitStep],
    fits: Sequence[StepFit],
    overlaps: Sequence[Overlap],
    between: Scatter | None,
    *,
    rivals: bool,
) -> contract.FitCycloidSummary:
    """Build the summary, with steps in chronological order; ``rivals`` adds the fits of the simpler models."""
    remarks = (*estimate.remarks, *_single_step_remarks(fits, between))
    return contract.FitCycloidSummary(
        **summary_fields(prepared, estimate, quality, remarks, "belt"),
        method=estimate.method,
        mass_kg=prepared.mass.known_kg,
        ahead=(float(walking_direction[0]), float(walking_direction[1])),
        steps=[_fitted_step(fit, rivals=rivals) for fit in fits],
        overlapping=[_overlapping_fit(overlap) for overlap in overlaps],
        step_to_step_sd=None if between is None else contract.StepScatter.from_object(between),
        steps_left_out=len(all_steps) - len(fits),
    )


def _single_step_remarks(fits: Sequence[StepFit], between: Scatter | None) -> tuple[Remark, ...]:
    if len(fits) > 1:
        return ()
    scatter = "its scatter is unknown" if between is None else "the scatter is that of overlapping intervals"
    return (Remark("one-step", f"Only one step could be fitted: {scatter}."),)


def _fitted_step(fit: StepFit, *, rivals: bool) -> contract.FittedStep:
    step, wheel, distance = fit.step, fit.path.wheel, MM * fit.path.distance_m
    _, R_sd, r_sd, z0_sd = (float(v) for v in fit.path.sd_m)
    return contract.FittedStep.from_object(
        fit,
        t0_s=step.start_s,
        t1_s=step.end_s,
        fitted_s=(float(fit.time_s[0]), float(fit.time_s[-1])),
        side=step.side,
        source=step.source,
        measured=step.measured,
        R_m=wheel.R_m,
        r_m=wheel.r_m,
        z0_m=wheel.z0_m,
        sd=contract.WheelSd(R_m=R_sd, r_m=r_sd, z0_m=z0_sd),
        error_mean_mm=float(distance.mean()),
        error_sd_mm=float(distance.std()),
        error_max_mm=float(distance.max()),
        double_support_s=step.double_support_s,
        period_s=step.period_s,
        step_length_m=step.length_m,
        speed_m_s=mean_speed_m_s(fit),
        reversed=_wheel_schema(fit.reversed_path, fit.time_s),
        timed=_timed_wheel(fit.timed),
        reversed_timed=_timed_wheel(fit.reversed_timed),
        rivals=[
            contract.Rival.from_object(c, space=space, rms_mm=MM * c.rms_m, held_out_mm=MM * c.held_out_rms_m)
            for space, contests in (("path", fit.path_rivals), ("time", fit.time_rivals))
            for c in contests
        ]
        if rivals
        else [],
    )


def mean_speed_m_s(fit: StepFit) -> float:
    """Mean forward speed of the CoM over the step, in m/s."""
    return float((fit.path_m[-1, 0] - fit.path_m[0, 0]) / (fit.time_s[-1] - fit.time_s[0]))


def _wheel_schema(fit: PathFit, time_s: Series) -> contract.Wheel:
    omega, theta0 = (float(v) for v in np.polyfit(time_s - time_s[0], fit.theta_rad, 1))
    return contract.Wheel.from_object(
        fit.wheel,
        omega_rad_s=omega,
        theta0_rad=theta0,
        error_mean_mm=float(MM * fit.distance_m.mean()),
        error_max_mm=float(MM * fit.distance_m.max()),
        converged=fit.converged,
    )


def _timed_wheel(fit: TimedFit) -> contract.TimedWheel:
    return contract.TimedWheel.from_object(
        fit.wheel,
        omega_rad_s=fit.omega_rad_s,
        theta0_rad=fit.theta0_rad,
        error_mean_mm=float(MM * fit.distance_m.mean()),
        error_max_mm=float(MM * fit.distance_m.max()),
        bounds=list(fit.bounds),
    )


def _overlapping_fit(overlap: Overlap) -> contract.OverlappingFit:
    return contract.OverlappingFit.from_object(
        overlap.wheel,
        t0_s=overlap.start_s,
        t1_s=overlap.end_s,
        omega_rad_s=overlap.omega_rad_s,
        error_mean_mm=MM * overlap.error_mean_m,
    )
