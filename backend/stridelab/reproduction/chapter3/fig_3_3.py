"""Figure 3.3: the three types of cycloid, and the path of the centre of mass beside the curtate one (3.2.5)."""

from typing import Final

import numpy as np

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Item, Reproduction, judged
from stridelab.reproduction.common.simulated_steps import NOTE, simulated_steps
from stridelab.reproduction.report.svg_plots import Curve, Panel, svg
from stridelab.walking.curtate_cycloid import FullTurn, Plane, Wheel
from stridelab.walking.step_fit import StepFit

RADIUS_M: Final = 0.1
TYPES: Final = {"normal": 1.0, "curtate": 0.3, "prolate": 1.5}
"""r over R of the three panels."""
THETA_RAD: Final = np.linspace(0.0, 2.0 * FullTurn, 721)
SIMILAR: Final = 0.1
"""A distance that is small beside the height that the path rises and falls."""


def run(seeds: int, tell: Progress) -> Reproduction:
    """Formulas, and the steps of one simulated walk; ``seeds`` changes nothing."""
    tell(0.05, "a person walks")
    fits = simulated_steps().fits
    tell(0.9, "comparing shapes")
    wheels = {name: _wheel(share) for name, share in TYPES.items()}
    paths = {name: wheel.position_m(THETA_RAD) for name, wheel in wheels.items()}
    found = Reproduction(
        claims=(*_types(wheels), *_shape(fits)),
        note=NOTE,
        tables={
            "cycloids": {"theta_rad": THETA_RAD}
            | {f"{name}_{axis}_m": path[:, k] for name, path in paths.items() for k, axis in enumerate("xz")},
        },
        drawing=svg(_panels(paths, fits[0])),
    )
    tell(1.0, "done")
    return found


def convex_share(wheel: Wheel) -> float:
    """Share of its length on which (3.1), (3.2) is convex: where cos theta > r / R, between its two bends."""
    bend = float(np.arccos(wheel.r_m / wheel.R_m))
    start, end = wheel.position_m(np.array([-bend, bend]))[:, 0]
    return float((end - start) / (FullTurn * wheel.R_m))


def _wheel(share: float) -> Wheel:
    return Wheel(R_m=RADIUS_M, r_m=share * RADIUS_M, z0_m=0.0, x0_m=0.0)


def _types(wheels: dict[str, Wheel]) -> tuple[Claim, ...]:
    """How fast the point goes ahead where it is slowest, over the speed of the hub: what tells the types apart."""
    least = {name: float((wheel.tangent_m(THETA_RAD)[:, 0] / wheel.R_m).min()) for name, wheel in wheels.items()}
    expected = {"normal": "stops", "curtate": "never stops", "prolate": "turns back"}
    holds = {
        "normal": abs(least["normal"]) < 1e-12,
        "curtate": least["curtate"] > 0.0,
        "prolate": least["prolate"] < 0.0,
    }
    return tuple(
        Claim(
            f"{name}_least_speed",
            f"{name} cycloid, r = {TYPES[name]:g} R: its least speed ahead over that of the hub",
            expected[name],
            value,
            "1",
            "met" if holds[name] else "not_met",
        )
        for name, value in least.items()
    )


def _shape(fits: tuple[StepFit, ...]) -> tuple[Claim, ...]:
    """What the last panel and 3.2.5 say of the path of the CoM."""
    similar = float(np.mean([f.path.distance_m.mean() / np.ptp(f.path_m[:, 1]) for f in fits]))
    inside = max(f.path.wheel.r_m / f.path.wheel.R_m for f in fits)
    convex = float(np.mean([convex_share(f.path.wheel) for f in fits]))
    return (
        Claim(
            "distance_over_rise",
            "the shape of the CoM trajectory is very similar to the curtate cycloid",
            "very similar",
            similar,
            "1",
            judged(similar, at_most=SIMILAR),
            f"Mean distance over the height that the path rises and falls, {len(fits)} steps, angles free. A sinusoid "
            "with as many parameters is closer (figure 3.5).",
        ),
        Claim(
            "r_over_R",
            "the cycloid of the CoM is curtate: r / R below 1",
            1.0,
            inside,
            "1",
            judged(inside, at_most=1.0),
            "The largest of the steps.",
        ),
        Claim(
            "convex_share",
            "the convex lower part of the cycle is longer than the concave higher part",
            "> 0.5",
            convex,
            "1",
            "met" if convex > 0.5 else "thesis_in_error",
            "Share of the length. (3.1) is convex where cos theta > r / R, less than half of it for every wheel with r "
            "above 0; the wheel of the other sign has the rest (docs/theory/misprints.md).",
        ),
    )


def _panels(paths: dict[str, Plane], fit: StepFit) -> list[Panel]:
    panels = [
        Panel(f"{name.capitalize()} cycloid, r = {TYPES[name]:g} R", "ahead (m)", "height (m)",
              [Curve(path[:, 0], path[:, 1], "point", k), Curve(path[:, 0], np.zeros(len(path)), "hub", 6, True)])
        for k, (name, path) in enumerate(paths.items())
    ]  # fmt: skip
    x, z = fit.path_m[:, 0] - fit.path_m[0, 0], fit.path_m[:, 1]
    model = fit.path.wheel.position_m(fit.path.theta_rad)
    curves = [Curve(x, z, "centre of mass", 0), Curve(model[:, 0] - fit.path_m[0, 0], model[:, 1], "curtate", 1, True)]
    return [*panels, Panel("Centre of mass in the sagittal plane", "ahead (m)", "height (m)", curves)]


ITEM: Final = Item("fig-3.3", "Three types of cycloid, and the centre of mass", run)
