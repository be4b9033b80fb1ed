"""The simulation study (section 2.5): a humanoid walks, and what an estimator would be given of it.

``simulate`` makes the three inputs of section 2.4.1 straight from the robot, without markers and plates in between: the
CoM of noisy configurations of a wrong body model, and the contact wrench with noise, bias and latency. The clean walk
is simulated once per gait; a seed costs 40 ms. ``simulated_recording`` is the long way, through a C3D.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from stridelab.body.geometric_com import GeometricCom, SegmentTrack
from stridelab.conventions import Mask, Points, Series
from stridelab.errors import Fault, InvalidInput
from stridelab.recordings.recording import Window, WrenchTrack
from stridelab.simulation.ground_truth import TrueMotion
from stridelab.simulation.human.body_proportions import SIDES
from stridelab.simulation.noise import PRESETS, NoisePreset, coloured
from stridelab.simulation.robot.forward_kinematics import LinkMasses, LinkPoses, link_masses, link_poses
from stridelab.simulation.robot.gait_plan import WALKS, GaitName
from stridelab.simulation.robot.runner import RUNNING, run
from stridelab.simulation.robot.walker import RATE_HZ, RobotWalk, walk

_PRIOR_DRAWS = 400
_LEAST_SD_M = 5e-4
"""A table without error is still declared with half a millimetre: a standard deviation of zero is no prior."""
_EPS_S = 1e-9


@dataclass(frozen=True, eq=False)
class StudyTrial:
    """What was measured and what was true, at ``RATE_HZ``, from time 0.

    ``geometric.sd_m`` declares the table's error as it was drawn. ``noise_sd_m`` is the standard deviation per axis
    that the configuration noise makes of the CoM (the "true noise" that the thesis' Kalman filter is told), and
    ``bias_m`` the error of the body model without it, ``(n, 3)``.
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

    def excerpt(self, start_s: float, end_s: float, *, force_s: tuple[float, float] | None = None) -> "StudyTrial":
        """The part from ``start_s`` to ``end_s``, begun again at time 0.

        ``force_s``, in the time of the excerpt, is when all contact is on plates; before and after, nothing is
        measured. Raises ``InvalidInput`` (``excerpt-invalid``) for an interval that is not inside the trial.
        """
        time_s = self.truth.time_s
        if not 0.0 <= start_s < end_s <= time_s[-1] + 1.0 / RATE_HZ + _EPS_S:
            message = f"An excerpt must lie between 0 and {time_s[-1]:.2f} s, not {start_s:g} to {end_s:g} s."
            raise InvalidInput("excerpt-invalid", message, [Fault("start_s", message)])
        kept = (time_s >= start_s - _EPS_S) & (time_s < end_s - _EPS_S)
        t = np.arange(int(kept.sum())) / RATE_HZ
        truth, geometric = self.truth, self.geometric
        return replace(
            self,
            truth=replace(_recorded(truth, kept), time_s=t),
            geometric=replace(
                geometric,
                time_s=t,
                com_m=geometric.com_m[kept],
                segments={k: SegmentTrack(s.mass_fraction, s.com_m[kept]) for k, s in geometric.segments.items()},
            ),
            wrench=_measured(t, self.wrench.force_n[kept], self.wrench.moment_nm[kept], force_s),
            bias_m=self.bias_m[kept],
        )


def simulate(gait: GaitName, noise: NoisePreset | str = "thesis", seed: int = 0, *, walk_seed: int = 0) -> StudyTrial:
    """One trial of a gait: ``seed`` draws all noise and the error of the body model, ``walk_seed`` varies the walk.

    ``noise`` is a preset or its name. The same arguments give the same trial, bit for bit; every part of the noise has
    its own random stream. Raises ``InvalidInput`` for a gait or a preset that does not exist.
    """
    preset = _preset(noise)
    source = clean_motion(gait, walk_seed)
    rngs = [np.random.default_rng([seed, part]) for part in range(5)]
    time_s = source.motion.time_s
    kept = (time_s > -_EPS_S) & (time_s < source.plan.duration_s - _EPS_S)
    t, n = time_s[kept], int(kept.sum())
    exact = link_masses(source.robot.model)
    believed = exact.wrong(preset.mass_model, rngs[3]) if preset.mass_model > 0.0 else exact
    q = source.motion.q[kept]
    clean = link_poses(source.robot.model, q)
    noisy = clean
    if preset.configuration_rad > 0.0:
        shaken = q.copy()
        sigma, joints = preset.configuration_rad, q.shape[1] - 7
        shaken[:, 7:] += coloured(rngs[0], n, joints, sigma, RATE_HZ, preset.high_pass_hz, preset.high_pass_order)
        noisy = link_poses(source.robot.model, shaken)
    truth = _recorded(source.truth, kept)
    geometric = _geometric(source, noisy, believed, t, preset.mass_model)
    biased = _com(clean, believed)
    sd_x, sd_y, sd_z = (float(s) for s in (geometric.com_m - biased).std(axis=0))
    force, moment = _wrench(source, t, preset, rngs[1], rngs[2], rngs[4])
    return StudyTrial(
        gait=gait,
        noise=preset,
        seed=seed,
        mass_kg=truth.mass_kg,
        step_time_s=source.plan.step_time_s,
        geometric=geometric,
        wrench=_measured(t, force, moment, None),
        truth=truth,
        noise_sd_m=(sd_x, sd_y, sd_z),
        bias_m=biased - truth.com_m,
    )


def clean_motion(gait: str, walk_seed: int = 0) -> RobotWalk:
    """The motion behind the trials of a gait, simulated once per process; do not change it.

    Raises ``InvalidInput`` (``gait-unknown``).
    """
    if gait == "running":
        return run(RUNNING, walk_seed)
    if gait not in WALKS:
        message = f"There is no gait {gait!r}: choose one of {', '.join(WALKS)} and running."
        raise InvalidInput("gait-unknown", message, [Fault("gait", message)])
    return walk(WALKS[gait], walk_seed)


def _preset(noise: NoisePreset | str) -> NoisePreset:
    if isinstance(noise, NoisePreset):
        return noise
    if noise not in PRESETS:
        message = f"There is no noise preset {noise!r}: choose one of {', '.join(PRESETS)}."
        raise InvalidInput("noise-unknown", message, [Fault("noise", message)])
    return PRESETS[noise]


def _recorded(truth: TrueMotion, kept: Mask) -> TrueMotion:
    return TrueMotion(
        truth.time_s[kept],
        truth.mass_kg,
        truth.com_m[kept],
        truth.velocity_m_s[kept],
        truth.acceleration_m_s2[kept],
        truth.momentum_nms[kept],
        truth.momentum_rate_nm[kept],
    )


def _com(poses: LinkPoses, masses: LinkMasses) -> Points:
    return np.asarray(np.tensordot(poses.coms_m(masses), masses.mass_kg / masses.mass_kg.sum(), axes=(1, 0)))


def _geometric(
    source: RobotWalk, poses: LinkPoses, believed: LinkMasses, time_s: Series, mass_model: float
) -> GeometricCom:
    """The segment model of the robot: one segment per link, named by the joint that carries it."""
    fractions, coms = believed.mass_kg / believed.mass_kg.sum(), poses.coms_m(believed)
    names = ("base", *source.robot.joint_names)
    segments: Mapping[str, SegmentTrack] = {
        name: SegmentTrack(float(fractions[k]), coms[:, k]) for k, name in enumerate(names)
    }
    return GeometricCom(
        time_s=time_s,
        com_m=_com(poses, believed),
        table="links",
        segments=segments,
        joint_centres_m={},
        sd_m=_declared_sd_m(source, mass_model),
    )


@lru_cache(maxsize=32)
def _declared_sd_m(source: RobotWalk, mass_model: float) -> tuple[float, float, float]:
    """Spread of the CoM of the first posture over body models that are wrong by ``mass_model``."""
    exact, rng = link_masses(source.robot.model), np.random.default_rng(0)
    poses = link_poses(source.robot.model, source.motion.q[:1])
    draws = np.array([_com(poses, exact.wrong(mass_model, rng))[0] for _ in range(_PRIOR_DRAWS)])
    x, y, z = (max(float(sd), _LEAST_SD_M) for sd in np.sqrt(np.mean((draws - _com(poses, exact)) ** 2, axis=0)))
    return x, y, z


def _wrench(
    source: RobotWalk,
    at_s: Series,
    noise: NoisePreset,
    forces: np.random.Generator,
    moments: np.random.Generator,
    biases: np.random.Generator,
) -> tuple[Points, Points]:
    """Force and moment at the world origin, late, noisy and biased at the plate."""
    truth, load, time_s = source.truth, source.load, source.motion.time_s
    force, moment = truth.force_n, truth.moment_nm
    plate = np.zeros_like(force)
    plate[:, :2] = sum(load.share[side][:, None] * load.cop_m[side] for side in SIDES)
    wrench = np.column_stack([force, moment, plate])
    if noise.latency_s == 0.0:
        read = wrench[np.searchsorted(time_s, at_s - _EPS_S)]
    else:
        read = CubicSpline(time_s, wrench)(at_s - noise.latency_s)
    force, moment, plate = read[:, :3].copy(), read[:, 3:6].copy(), read[:, 6:]
    error_n, error_nm = np.zeros_like(force), np.zeros_like(force)
    if noise.force_n > 0.0:
        error_n += coloured(forces, len(force), 3, noise.force_n, RATE_HZ, noise.high_pass_hz, noise.high_pass_order)
    if noise.moment_nm > 0.0:
        error_nm += coloured(
            moments, len(force), 3, noise.moment_nm, RATE_HZ, noise.high_pass_hz, noise.high_pass_order
        )
    error_n += noise.plate_bias_n * biases.standard_normal(3)
    error_nm += noise.plate_bias_nm * biases.standard_normal(3)
    return force + error_n, moment + error_nm + np.cross(plate, error_n)


def _measured(time_s: Series, force_n: Points, moment_nm: Points, force_s: tuple[float, float] | None) -> WrenchTrack:
    """The wrench on plates: everywhere, or from ``force_s[0]`` to ``force_s[1]`` with nothing around it."""
    start_s, end_s = force_s or (0.0, float(time_s[-1]))
    complete = (time_s >= start_s - _EPS_S) & (time_s <= end_s + _EPS_S)
    seen = complete[:, None]
    windows = (Window(float(time_s[complete][0]), float(time_s[complete][-1])),) if complete.any() else ()
    return WrenchTrack(time_s, np.where(seen, force_n, 0.0), np.where(seen, moment_nm, 0.0), complete, windows)
