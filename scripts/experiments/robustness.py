"""Robustness of the replays of experiments 1 to 3: fixed disturbances, and largest disturbances by bisection."""

from collections.abc import Callable, Mapping
from typing import Final

from stridelab.wholebody.replay.disturbances import Disturbances, Push, SensorNoise

EXPERIMENTS: Final = ("long-stride", "six-stairs", "stairs-with-rail")
DISPLACEMENT_M: Final = 0.015
"""Displacement of stairs and rail from their planned position."""
BISECTIONS: Final = 4
PUSH_NS: Final = 20.0
N_INSTANTS: Final = 12
"""Number of instants of the motion at which a push is applied; single support is less robust than double support."""
SIDES: Final[Mapping[str, float]] = {"left": 1.0, "right": -1.0}


def fixed_disturbances(duration_s: float) -> Mapping[str, Disturbances]:
    """Fixed disturbances for every experiment; pushes are applied in the middle of the motion."""
    return {
        "friction 0.3": Disturbances(friction=0.3),
        "sole 0.18 x 0.10 m": Disturbances(sole_half_size_m=(0.09, 0.05)),
        "torque noise 5 %": Disturbances(torque_noise=0.05),
        "stairs and rail 15 mm higher": Disturbances(
            terrain_up_m=DISPLACEMENT_M, rail_shift_m=(0.0, 0.0, DISPLACEMENT_M)
        ),
        "stairs and rail 15 mm lower": Disturbances(
            terrain_up_m=-DISPLACEMENT_M, rail_shift_m=(0.0, 0.0, -DISPLACEMENT_M)
        ),
        "rail 15 mm nearer": Disturbances(rail_shift_m=(0.0, DISPLACEMENT_M, 0.0)),
        "rail 15 mm farther": Disturbances(rail_shift_m=(0.0, -DISPLACEMENT_M, 0.0)),
        "stabiliser alone 5 ms late": Disturbances(delay_s=0.005),
        "control 2 ms late": Disturbances(delay_s=0.002, joint_delay_s=0.002),
        "noisy sensors": Disturbances(sensor_noise=SensorNoise()),
        "trunk 5 kg heavier": Disturbances(trunk_mass_kg=5.0),
    } | {f"push of 20 Ns to the {side}": lateral_push(duration_s / 2.0, y * PUSH_NS) for side, y in SIDES.items()}


def lateral_push(time_s: float, impulse_ns: float) -> Disturbances:
    """Push to the left; a negative impulse pushes to the right."""
    return Disturbances(pushes=(Push(time_s, (0.0, impulse_ns, 0.0)),))


def push_times_s(duration_s: float) -> tuple[float, ...]:
    """Times of pushes, uniformly distributed over the motion without its ends."""
    return tuple(duration_s * (k + 0.5) / N_INSTANTS for k in range(N_INSTANTS))


def scalable_disturbances(duration_s: float) -> Mapping[str, tuple[float, Callable[[float], Disturbances]]]:
    """Disturbances as functions of their size, each with a size at which the replay fails."""

    def push_of_size(y: float) -> Callable[[float], Disturbances]:
        return lambda ns: lateral_push(duration_s / 2.0, y * ns)

    def raised_by(z: float) -> Callable[[float], Disturbances]:
        return lambda mm: Disturbances(terrain_up_m=z * 1e-3 * mm, rail_shift_m=(0.0, 0.0, z * 1e-3 * mm))

    def smaller_sole(mm: float) -> Disturbances:
        return Disturbances(sole_half_size_m=(0.10 - 1e-3 * mm, 0.06 - 1e-3 * mm))

    return {
        "push to the left (Ns)": (50.0, push_of_size(1.0)),
        "push to the right (Ns)": (50.0, push_of_size(-1.0)),
        "load on the trunk (kg)": (25.0, lambda kg: Disturbances(trunk_mass_kg=kg)),
        "stairs and rail higher (mm)": (60.0, raised_by(1.0)),
        "stairs and rail lower (mm)": (60.0, raised_by(-1.0)),
        # halves are whole steps of 1 ms
        "stabiliser alone late (ms)": (64.0, lambda ms: Disturbances(delay_s=1e-3 * ms)),
        "control late (ms)": (16.0, lambda ms: Disturbances(delay_s=1e-3 * ms, joint_delay_s=1e-3 * ms)),
        "sole less on every side (mm)": (40.0, smaller_sole),
        "friction below 0.3 by": (0.29, lambda less: Disturbances(friction=0.3 - less)),
    }


def applies_to(experiment: str, disturbance: str) -> bool:
    """Whether a disturbance applies: only experiment 3 has a rail, and experiment 1 has no stairs."""
    return not (disturbance.startswith("rail") and "rail" not in experiment) and not (
        disturbance.startswith("stairs") and "stairs" not in experiment
    )


def survival_boundary(survives: Callable[[float], bool], too_much: float) -> float:
    """The largest size that the replay survives, by bisection in [0, ``too_much``]; assumes monotone survival."""
    low, high = 0.0, too_much
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if survives(middle):
            low = middle
        else:
            high = middle
    return low
