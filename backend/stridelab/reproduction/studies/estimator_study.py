"""Simulation study of the CoM estimators (section 2.5): simulated measurements of a walking humanoid.

``simulate`` computes the three inputs of section 2.4.1 directly from the robot, without markers and force plates: the
CoM of noisy configurations of an inaccurate body model, and the contact wrench with noise, bias and latency. The clean
walk is simulated once per gait; a seed takes 40 ms. ``simulated_recording`` writes a complete C3D file instead.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.conventions import Points, Series
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Window, WrenchTrack
from stridelab.simulation.ground_truth import TrueMotion
from stridelab.simulation.human.body_proportions import SIDES
from stridelab.simulation.noise import PRESETS, NoisePreset, coloured_noise
from stridelab.simulation.robot.forward_kinematics import LinkMasses, LinkPoses, link_masses, link_poses
from stridelab.simulation.robot.gait_plan import WALKS, GaitName
from stridelab.simulation.robot.runner import RUNNING, simulate_run
from stridelab.simulation.robot.walker import RATE_HZ, RobotWalk, simulate_walk

_PRIOR_DRAWS = 400
_LEAST_SD_M = 5e-4
"""Minimum declared standard deviation of the segment table: zero is not a valid prior."""


@dataclass(frozen=True, eq=False)
class StudyTrial:
    """Measurements and ground truth of one trial, sampled at ``RATE_HZ`` from time 0.

    ``geometric.sd_m`` is the standard deviation from which the body model error was drawn. ``noise_sd_m`` is the
    standard deviation per axis of the CoM due to configuration noise (the "true noise" used by the thesis' Kalman
    filter), and ``bias_m`` the error of the body model without noise, ``(n, 3)``.
    """

    gait: GaitName
    noise: NoisePreset
    seed: int
    mass_kg: float
    step_time_s: float
    geometric: GeometricCom
    wrench: WrenchTrack
    truth: TrueMotion
    noise_sd_m: tuple[float, float, float]
    bias_m: Points

    def excerpt_between(
        self, start_s: float, end_s: float, *, force_s: tuple[float, float] | None = None
    ) -> "StudyTrial":
        """The part from ``start_s`` to ``end_s``, to the nearest sample, with time shifted to start at 0.

        ``force_s`` is the interval, in the time of the excerpt, in which the force is measured; outside it is not.
        Raises ``InvalidInput`` (``excerpt-invalid``) for an interval that is not inside the trial.
        """
        time_s = self.truth.time_s
        first, end = (round(at_s * RATE_HZ) for at_s in (start_s, end_s))
        if not 0 <= first < end <= len(time_s):
            message = f"An excerpt must lie between 0 and {time_s[-1]:.2f} s, not {start_s:g} to {end_s:g} s."
            raise InvalidInput("excerpt-invalid", message, [Fault("start_s", message)])
        inside = slice(first, end)
        t = np.arange(end - first) / RATE_HZ
        truth, geometric = self.truth, self.geometric
        return replace(
            self,
            truth=replace(_truth_within(truth, inside), time_s=t),
            geometric=replace(
                geometric,
                time_s=t,
                com_m=geometric.com_m[inside],
                segments={k: SegmentTrack(s.mass_fraction, s.com_m[inside]) for k, s in geometric.segments.items()},
            ),
            wrench=_wrench_track(t, self.wrench.force_n[inside], self.wrench.moment_nm[inside], force_s),
            bias_m=self.bias_m[inside],
        )


def simulate_trial(
    gait: GaitName, noise: NoisePreset | str = "thesis", seed: int = 0, *, walk_seed: int = 0
) -> StudyTrial:
    """Simulate one trial of a gait; ``seed`` draws the noise and the body model error, ``walk_seed`` varies the walk.

    ``noise`` is a preset or its name. The same arguments give the same trial, bit for bit; every noise source has its
    own random stream. Raises ``InvalidInput`` for an unknown gait or preset.
    """
    preset = _preset_of(noise)
    source = clean_motion(gait, walk_seed)
    joints_rng, forces_rng, moments_rng, masses_rng, biases_rng = (
        np.random.default_rng([seed, part]) for part in range(5)
    )
    time_s = source.motion.time_s
    recorded = slice(*np.searchsorted(np.rint(time_s * RATE_HZ), [0, round(source.plan.duration_s * RATE_HZ)]))
    t = time_s[recorded]
    exact = link_masses(source.robot.model)
    body_model = exact.perturb(preset.mass_model, masses_rng) if preset.mass_model > 0.0 else exact
    q = source.motion.q[recorded]
    clean = link_poses(source.robot.model, q)
    noisy = clean
    if preset.configuration_rad > 0.0:
        noisy_q = q.copy()
        sigma, joints = preset.configuration_rad, q.shape[1] - 7
        noisy_q[:, 7:] += coloured_noise(
            joints_rng, len(t), joints, sigma, RATE_HZ, preset.high_pass_hz, preset.high_pass_order
        )
        noisy = link_poses(source.robot.model, noisy_q)
    truth = _truth_within(source.truth, recorded)
    geometric = _geometric_com(source, noisy, body_model, t, preset.mass_model)
    biased = _com_of_links(clean, body_model)
    sd_x, sd_y, sd_z = (float(s) for s in (geometric.com_m - biased).std(axis=0))
    force, moment = _noisy_wrench(source, t, preset, forces_rng, moments_rng, biases_rng)
    return StudyTrial(
        gait=gait,
        noise=preset,
        seed=seed,
        mass_kg=truth.mass_kg,
        step_time_s=source.plan.step_time_s,
        geometric=geometric,
        wrench=_wrench_track(t, force, moment, None),
        truth=truth,
        noise_sd_m=(sd_x, sd_y, sd_z),
        bias_m=biased - truth.com_m,
    )


def clean_motion(gait: str, walk_seed: int = 0) -> RobotWalk:
    """Noise-free motion of a gait, simulated once per process; the result must not be modified.

    Raises ``InvalidInput`` (``gait-unknown``).
    """
    if gait == "running":
        return simulate_run(RUNNING, walk_seed)
    if gait not in WALKS:
        message = f"There is no gait {gait!r}: choose one of {', '.join(WALKS)} and running."
        raise InvalidInput("gait-unknown", message, [Fault("gait", message)])
    return simulate_walk(WALKS[gait], walk_seed)


def _preset_of(noise: NoisePreset | str) -> NoisePreset:
    if isinstance(noise, NoisePreset):
        return noise
    if noise not in PRESETS:
        message = f"There is no noise preset {noise!r}: choose one of {', '.join(PRESETS)}."
        raise InvalidInput("noise-unknown", message, [Fault("noise", message)])
    return PRESETS[noise]


def _truth_within(truth: TrueMotion, inside: slice) -> TrueMotion:
    return TrueMotion(
        truth.time_s[inside],
        truth.mass_kg,
        truth.com_m[inside],
        truth.velocity_m_s[inside],
        truth.acceleration_m_s2[inside],
        truth.momentum_nms[inside],
        truth.momentum_rate_nm[inside],
    )


def _com_of_links(poses: LinkPoses, masses: LinkMasses) -> Points:
    return np.asarray(np.tensordot(poses.coms_m(masses), masses.mass_kg / masses.mass_kg.sum(), axes=(1, 0)))


def _geometric_com(
    source: RobotWalk, poses: LinkPoses, believed: LinkMasses, time_s: Series, mass_model: float
) -> GeometricCom:
    """Geometric CoM of the robot with one segment per link, named after its parent joint."""
    fractions, coms = believed.mass_kg / believed.mass_kg.sum(), poses.coms_m(believed)
    names = ("base", *source.robot.joint_names)
    segments: Mapping[str, SegmentTrack] = {
        name: SegmentTrack(float(fractions[k]), coms[:, k]) for k, name in enumerate(names)
    }
    return GeometricCom(
        time_s=time_s,
        com_m=_com_of_links(poses, believed),
        table="links",
        segments=segments,
        joint_centres_m={},
        sd_m=_declared_sd_m(source, mass_model),
    )


@lru_cache(maxsize=32)
def _declared_sd_m(source: RobotWalk, mass_model: float) -> tuple[float, float, float]:
    """Standard deviation of the CoM of the first posture over random body models with the error ``mass_model``."""
    exact, rng = link_masses(source.robot.model), np.random.default_rng(0)
    poses = link_poses(source.robot.model, source.motion.q[:1])
    draws = np.array([_com_of_links(poses, exact.perturb(mass_model, rng))[0] for _ in range(_PRIOR_DRAWS)])
    x, y, z = (
        max(float(sd), _LEAST_SD_M) for sd in np.sqrt(np.mean((draws - _com_of_links(poses, exact)) ** 2, axis=0))
    )
    return x, y, z


def _noisy_wrench(
    source: RobotWalk,
    sample_times_s: Series,
    noise: NoisePreset,
    forces: np.random.Generator,
    moments: np.random.Generator,
    biases: np.random.Generator,
) -> tuple[Points, Points]:
    """Force and moment about the world origin with latency, and with noise and bias applied at the plate."""
    truth, load, time_s = source.truth, source.load, source.motion.time_s
    force, moment = truth.force_n, truth.moment_nm
    plate = np.zeros_like(force)
    plate[:, :2] = sum(load.share[side][:, None] * load.cop_m[side] for side in SIDES)
    wrench = np.column_stack([force, moment, plate])
    force, moment, plate = np.split(CubicSpline(time_s, wrench)(sample_times_s - noise.latency_s), 3, axis=1)
    error_n, error_nm = (
        coloured_noise(rng, len(force), 3, sigma, RATE_HZ, noise.high_pass_hz, noise.high_pass_order)
        for rng, sigma in ((forces, noise.force_n), (moments, noise.moment_nm))
    )
    error_n += noise.plate_bias_n * biases.standard_normal(3)
    error_nm += noise.plate_bias_nm * biases.standard_normal(3)
    return force + error_n, moment + error_nm + np.cross(plate, error_n)


def _wrench_track(
    time_s: Series, force_n: Points, moment_nm: Points, force_s: tuple[float, float] | None
) -> WrenchTrack:
    """Wrench measured everywhere, or only from ``force_s[0]`` to ``force_s[1]``, to the nearest sample."""
    complete = np.ones(len(time_s), dtype=bool)
    if force_s is not None:
        first, last = (round(at_s * RATE_HZ) for at_s in force_s)
        complete = (np.arange(len(time_s)) >= first) & (np.arange(len(time_s)) <= last)
    measured = complete[:, None]
    start_s, end_s = time_s[complete][[0, -1]].tolist()
    force_n, moment_nm = np.where(measured, force_n, 0.0), np.where(measured, moment_nm, 0.0)
    return WrenchTrack(time_s, force_n, moment_nm, complete, (Window(start_s, end_s),))
