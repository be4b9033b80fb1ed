"""What the values of a result mean, by their key in its summary.

Those of estimates and simulations are translated; those of contact plans, densities and robots are English, as their
names.
"""

from collections.abc import Mapping
from typing import Final

from stridelab_web.pages.terms.term import Term

_WINDOW: Final = "/help/theory/windows-and-mass#when-all-contact-force-is-measured"
_TREADMILL: Final = "/help/theory/windows-and-mass#treadmills"
_MASS: Final = "/help/theory/windows-and-mass#body-mass"
_CLOCKS: Final = "/help/theory/synchronisation#the-estimate"
_APPLIED: Final = "/help/theory/synchronisation#applying-the-latency"
_SESSION: Final = "/help/theory/sessions#the-formula"
_ESTIMATE: Final = "/help/tutorials/human-wing#estimate"
_ACCURATE: Final = "/help/tutorials/human-wing#how-accurate-is-it"
_SMOOTHER: Final = "/help/theory/smoother#stated-and-learned-noise-levels"
_MOMENTUM: Final = "/help/theory/smoother#the-segments-angular-momentum"
_FILTER: Final = "/help/theory/complementary-filter#what-the-filters-let-pass"
_KALMAN: Final = "/help/theory/kalman-filter"
_OBSERVABLE: Final = "/help/theory/observability"
_QUALITY: Final = "/help/theory/quality"
_WALKER: Final = "/help/theory/simulated-walker"
_PLANNER: Final = "/help/theory/contact-planner"
_SCENARIO: Final = "/help/contact-sequences"
_DENSITY: Final = "/help/theory/reachability#method"
_COMMISSION: Final = "/help/how-to/add-a-robot#what-the-robot-can-do"

ESTIMATE_TERMS: Final[Mapping[str, Term]] = {
    "window_s": Term("the part of the recording that was used, with all contact force measured", _WINDOW),
    "method": Term("how markers and forces were combined", _ESTIMATE),
    "segment_table": Term("source of the masses of the body's segments", _ACCURATE),
    "mass_kg": Term("body mass that was used", _MASS),
    "mass_sd_kg": Term("uncertainty of the body mass that was used", _MASS),
    "mass_from_force_kg": Term("body mass that the force plates weigh", _MASS),
    "mass_source": Term("where the body mass that was used comes from", _MASS),
    "latency_s": Term("how much later than the markers the force arrives", _CLOCKS),
    "latency_sd_s": Term("uncertainty of the latency", _CLOCKS),
    "latency_applied_s": Term("by how much the force was moved in time", _APPLIED),
    "latency_source": Term("whether the latency is that of this trial or of its session", _SESSION),
    "latency_n_trials": Term("from how many trials the latency was estimated", _SESSION),
    "latency_trial_s": Term("the latency that this trial alone would give", _SESSION),
    "latency_trial_sd_s": Term("uncertainty of the latency of this trial alone", _SESSION),
    "latency_along_s": Term("the latency from forces ahead and back alone", _CLOCKS),
    "latency_lateral_s": Term("the latency from sideways forces alone", _CLOCKS),
    "latency_vertical_s": Term("the latency from vertical forces alone", _CLOCKS),
    "session.latency_excess_s": Term("by how much latencies of trials differ beyond their own uncertainty", _SESSION),
    "session.mass_kg": Term("body mass that all trials of the session weigh together", _SESSION),
    "session.mass_sd_kg": Term("uncertainty of the session's body mass", _SESSION),
    "session.mass_n_trials": Term("how many trials of the session weigh the person", _SESSION),
    "session.plate_zeros": Term(
        "what an unloaded force plate reads in the other trials", "/help/theory/sessions#the-zero-of-a-plate"
    ),
    "proposed_names": Term("label taken for this landmark; to be checked", "/help/file-formats"),
    "treadmill.left_m_s": Term("speed of the belt on which the left foot stands", _TREADMILL),
    "treadmill.right_m_s": Term("speed of the belt on which the right foot stands", _TREADMILL),
    "treadmill.source": Term("whether the speeds were stated or taken from the standing feet", _TREADMILL),
    "treadmill.frame": Term("whether positions rest with the laboratory or move with the belt", _TREADMILL),
    "rms_force_residual_n": Term("force that the estimated motion does not explain", _QUALITY),
    "bias_m": Term("mean difference between the estimate and the one from markers alone", _ACCURATE),
    "rate_hz": Term("samples of the estimate per second", _ESTIMATE),
    "speed_m_s": Term("mean speed of the walk", _WALKER),
    "n_steps": Term("number of steps", _WALKER),
    "diagnostics.marker_mm": Term("scatter of the centre of mass from sample to sample due to the markers", _SMOOTHER),
    "diagnostics.table_varying_mm": Term("error of the segment table that changes with the posture", _SMOOTHER),
    "diagnostics.momentum_about_walk_nms": Term("how much the body turns about the axis of the walk", _MOMENTUM),
    "diagnostics.momentum_about_side_nms": Term("how much the body turns about the sideways axis", _MOMENTUM),
    "diagnostics.step_hz": Term("steps per second that the smoother assumes", _SMOOTHER),
    "diagnostics.speed_m_s": Term("mean speed of the walk in the window", _SMOOTHER),
    "diagnostics.low_hz": Term("slower motion than this is taken from the markers", _FILTER),
    "diagnostics.high_hz": Term("faster motion than this is taken from the force", _FILTER),
    "diagnostics.normalised_innovations": Term(
        "surprise of the sensors over that expected; far from 1 is doubtful", _QUALITY
    ),
    "diagnostics.plate_bias_statistic": Term("evidence for a force plate that reads a constant error", _QUALITY),
    "diagnostics.samples_used": Term("number of samples in the window", _FILTER),
    "diagnostics.clock_ms": Term("remaining difference of the clocks of force and markers", _CLOCKS),
    "diagnostics.clock_sd_ms": Term("uncertainty of the remaining difference of the clocks", _CLOCKS),
    "diagnostics.band_hz": Term("faster motion than this is removed from the markers", _FILTER),
    "diagnostics.sigma_jerk_m_s3": Term("how quickly the filter lets the acceleration change", _KALMAN),
    "diagnostics.model_sd_x_m": Term("uncertainty along x that the filter itself states", _KALMAN),
    "diagnostics.model_sd_y_m": Term("uncertainty along y that the filter itself states", _KALMAN),
    "diagnostics.model_sd_z_m": Term("uncertainty in height that the filter itself states", _KALMAN),
    "diagnostics.lag_x_s": Term("by how much the filter is late along x at each stride", _KALMAN),
    "diagnostics.lag_y_s": Term("by how much the filter is late along y at each stride", _KALMAN),
    "diagnostics.lag_z_s": Term("by how much the filter is late in height at each stride", _KALMAN),
    "observability.rank_force": Term("number of quantities that the force alone determines", _OBSERVABLE),
    "observability.rank_with_geometry": Term(
        "number of quantities that force and markers determine together", _OBSERVABLE
    ),
    "observability.unobservable": Term("direction in which the force does not show the position", _OBSERVABLE),
    "observability.tilt_rad": Term("how far that direction is from the vertical", _OBSERVABLE),
    "observability.turn_rad": Term("how far that direction changes during the window", _OBSERVABLE),
    "observability.flight_s": Term("time without any contact, when the force shows no position", _OBSERVABLE),
}
"""Values of ``estimate-com`` and of a simulated recording; their meanings are translated."""

OTHER_TERMS: Final[Mapping[str, Term]] = {
    "name": Term("name of the planned scenario", _SCENARIO),
    "description": Term("what the planned scenario is about", _SCENARIO),
    "friction": Term("coefficient of friction of all surfaces", "/help/theory/wrench-cones"),
    "start_com_height_m": Term("height of the centre of mass above the soles at the start", _SCENARIO),
    "steps": Term("number of steps", _PLANNER),
    "duration_s": Term("length of the motion", _PLANNER),
    "objective_m": Term("how far the placements are from even steps, in all", f"{_PLANNER}#program"),
    "programs": Term("how many optimisation problems were solved", f"{_PLANNER}#order-number-of-steps-durations"),
    "solve_time_s": Term("time of all these solutions", f"{_PLANNER}#measured"),
    "certified": Term("whether the whole body passed its certificate", f"{_PLANNER}#a-certificate-that-fails"),
    "robot": Term("the robot that was used", "/help/how-to/add-a-robot"),
    "robot_sha256": Term(
        "changes as soon as the robot's description does", "/help/theory/reachability#files-and-reproducibility"
    ),
    "measure": Term("which postures were sampled", "/help/theory/reachability#the-measure-of-a-robot-that-stands"),
    "samples": Term("sampled postures that were used", _DENSITY),
    "tried": Term("postures that were sampled in all", _DENSITY),
    "rejected_share": Term("share of the sampled postures that was rejected", _DENSITY),
    "learned_on": Term("day on which the densities were learned", _DENSITY),
    "frame": Term("axes of the density", "/help/theory/reachability#the-measure-of-a-robot-that-stands"),
    "components": Term("number of Gaussian bells in the mixture", "/help/theory/reachability#which-size"),
    "thesis_components": Term("number of Gaussian bells that the thesis uses", "/help/theory/reachability#which-size"),
    "kl_nats": Term("how much the mixture differs from the sampled postures", "/help/theory/reachability#which-size"),
    "kl_sd_nats": Term("uncertainty of that difference", "/help/theory/reachability#which-size"),
    "held_out_log_likelihood": Term("how well the mixture predicts postures that it has not seen", _DENSITY),
    "bandwidth_m": Term("how far each sampled posture is smeared out", _DENSITY),
    "mode_m": Term(
        "the most usual place of the centre of mass", "/help/theory/reachability#the-mode-is-a-folded-posture"
    ),
    "completed": Term("whether the physics simulation reached the end of the motion", _COMMISSION),
    "step_m": Term("length of a step", _COMMISSION),
    "mass_kg": Term("mass of all links together", _COMMISSION),
    "seconds": Term("time that this part of the work took", _COMMISSION),
    "com_height_m": Term("height of the centre of mass in the standing posture", _COMMISSION),
    "foot_spacing_m": Term("distance between the feet in the standing posture", _COMMISSION),
    "torque_ratio_max": Term("largest torque of a joint; 1 is its limit", _COMMISSION),
}
"""Values of ``plan-contacts``, ``learn-reachability`` and ``commission-robot``, by the last part of their key."""


def result_term(key: str) -> Term | None:
    """The explanation of the value under the dotted ``key`` of a summary; None for one of another version.

    A key without one has that of what contains it, as ``proposed_names.l_heel``.
    """
    parts = key.split(".")
    beginnings = (".".join(parts[:k]) for k in range(len(parts), 0, -1))
    exact = next((ESTIMATE_TERMS[one] for one in beginnings if one in ESTIMATE_TERMS), None)
    return exact or next((OTHER_TERMS[one] for one in reversed(parts) if one in OTHER_TERMS), None)
