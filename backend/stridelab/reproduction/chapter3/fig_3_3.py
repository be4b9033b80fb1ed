"""Figure 3.3: the three types of cycloid, and the path of the centre of mass with its curtate cycloid (3.2.5)."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.claims import (
    DETERMINISTIC,
    Claim,
    Measured,
    Reproduction,
    above,
    below,
    reproduces,
    target,
    within,
)
from stridelab.reproduction.common.intervals import interval_of
from stridelab.reproduction.common.simulated_steps import NOTE, simulated_steps
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.walking.curtate_cycloid import FULL_TURN_RAD, Plane, Wheel
from stridelab.walking.step_fit import StepFit

RADIUS_M: Final = 0.1
TYPES: Final = {"normal": 1.0, "curtate": 0.3, "prolate": 1.5}
"""r over R of the three panels."""
THETA_RAD: Final = np.linspace(0.0, 2.0 * FULL_TURN_RAD, 721)
MAX_RELATIVE_DISTANCE: Final = 0.1
"""Maximum mean distance relative to the vertical excursion that counts as "very similar"."""


@reproduces("fig-3.3", "Three types of cycloid, and the centre of mass", draws="one")
def run(seeds: range, tell: Progress) -> Reproduction:
    """Closed-form cycloids and the steps of one simulated walk."""
    tell(0.05, "simulating a walk")
    fits = simulated_steps(seeds[0]).fits
    tell(0.9, "comparing shapes")
    wheels = {name: _wheel_of_type(share) for name, share in TYPES.items()}
    paths = {name: wheel.position_m(THETA_RAD) for name, wheel in wheels.items()}
    return Reproduction(
        claims=(*_type_claims(wheels), _convexity_claim(wheels["curtate"]), _fit_target(fits)),
        note=NOTE,
        tables={
            "cycloids": {"theta_rad": THETA_RAD}
            | {f"{name}_{axis}_m": path[:, k] for name, path in paths.items() for k, axis in enumerate("xz")},
        },
        drawing=render_svg(*_draw_panels(paths, fits[0])),
        n=len(fits),
    )


def convex_share(wheel: Wheel) -> float:
    """Share of the length on which (3.1), (3.2) is convex: cos theta > r / R, between the inflection points."""
    bend = float(np.arccos(wheel.r_m / wheel.R_m))
    start, end = wheel.position_m(np.array([-bend, bend]))[:, 0]
    return float((end - start) / (FULL_TURN_RAD * wheel.R_m))


def _wheel_of_type(share: float) -> Wheel:
    return Wheel(R_m=RADIUS_M, r_m=share * RADIUS_M, z0_m=0.0, x0_m=0.0)


def _type_claims(wheels: dict[str, Wheel]) -> tuple[Claim, ...]:
    """Minimum forward speed of the point over the speed of the hub, which distinguishes the types."""
    least = {name: float((wheel.tangent_m(THETA_RAD)[:, 0] / wheel.R_m).min()) for name, wheel in wheels.items()}
    expected = {"normal": "stops", "curtate": "never stops", "prolate": "turns back"}
    holds = {
        "normal": within(-1e-12, 1e-12, "words"),
        "curtate": above(0.0, "words"),
        "prolate": below(0.0, "words"),
    }
    return tuple(
        Measured(f"{name}_least_speed", expected[name], value, "1", holds[name]).says(
            f"{name} cycloid, r = {TYPES[name]:g} R: minimum forward speed over that of the hub",
            **DETERMINISTIC,
        )
        for name, value in least.items()
    )


def _convexity_claim(wheel: Wheel) -> Claim:
    """3.2.5 on the curve itself, without a walker."""
    convex = convex_share(wheel)
    return Measured("convex_share", "longer", convex, "1", above(0.5, "words", otherwise="thesis_in_error")).says(
        "the curve (3.1), (3.2) is asymmetric: its convex lower part is longer than its concave higher part",
        f"Share of the length, r = {TYPES['curtate']:g} R. The curve is convex where cos theta > r / R, which is less "
        "than half of the length for every r above 0; the cycloid with the opposite sign has the complement "
        "(docs/theory/misprints.md). On people, without a curve: item fig-3.3-people.",
        **DETERMINISTIC,
        where="3.2.5",
    )


def _fit_target(fits: tuple[StepFit, ...]) -> Claim:
    """The fit follows a path that is no cycloid; no verdict on the thesis."""
    similar = [float(f.path.distance_m.mean() / np.ptp(f.path_m[:, 1])) for f in fits]
    return target("distance_over_rise", float(np.mean(similar)), "1", at_most=MAX_RELATIVE_DISTANCE).says(
        "simulated walker: mean distance of the wheel over the vertical excursion",
        f"{len(fits)} steps, free angles. The height is a cosine by construction: people are in fig-3.3-people.",
        interval=interval_of(similar),
    )


def _draw_panels(paths: dict[str, Plane], fit: StepFit) -> list[Panel]:
    panels = [
        Panel(
            f"{name.capitalize()} cycloid, r = {TYPES[name]:g} R",
            "ahead (m)",
            "height (m)",
            [Curve(path[:, 0], path[:, 1], "point", k), Curve(path[:, 0], np.zeros(len(path)), "hub", 6, True)],
        )
        for k, (name, path) in enumerate(paths.items())
    ]
    x, z = fit.path_m[:, 0] - fit.path_m[0, 0], fit.path_m[:, 1]
    model = fit.path.wheel.position_m(fit.path.theta_rad)
    curves = [Curve(x, z, "centre of mass", 0), Curve(model[:, 0] - fit.path_m[0, 0], model[:, 1], "curtate", 1, True)]
    return [*panels, Panel("Centre of mass in the sagittal plane", "ahead (m)", "height (m)", curves)]
