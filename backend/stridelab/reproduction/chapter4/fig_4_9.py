"""Figure 4.9: the CoM in the frame of the right foot, with and without the log-densities in the cost.

Experiment 2 with HRP-2. While the right foot is in contact, the CoM is drawn in its frame over the reachability
density. Its likelihood is measured by the share of the density's mass with lower or equal density
(``reach_box.usual_share``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from skimage.measure import find_contours

from stridelab.centroidal.boundary_conditions import PathBounds
from stridelab.centroidal.plan import CentroidalPlan
from stridelab.centroidal.reach_box import usual_share
from stridelab.centroidal.solver import solve
from stridelab.conventions import Mask, Points, Progress, Series
from stridelab.reachability.card import Measure
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.store import load_proxies
from stridelab.reproduction.claims import Claim, Column, Measured, Reproduction, above, reproduces, target
from stridelab.reproduction.report.svg_plots import Curve, Panel, render_svg
from stridelab.reproduction.studies.thesis_experiments import experiment_problem

ROBOT: Final = "hrp2"
FOOT: Final = "right_foot"
MEASURES: Final[tuple[Measure, ...]] = ("uniform", "conditioned")
CASES: Final = ("with", "without")
MASS: Final = 0.95
LEVELS: Final = (0.5, 0.8, 0.95)
RARE_SHARE: Final = 1.0 - MASS
MARGIN_M: Final = 0.15
GRID: Final = 81
COM_HEIGHT_M: Final = (0.5, 0.9)
"""Height of the CoM above the soles in all plans: HRP-2 stands at 0.79 m, and its legs are straight at 0.9 m."""


@dataclass(frozen=True, eq=False)
class ComPath:
    """CoM in the foot's frame while in contact (NaN otherwise), and its likelihood at each node."""

    measure: Measure
    case: str
    time_s: Series
    com_m: Points
    share: Series
    log_density: Series
    solver: str

    @property
    def in_contact(self) -> Mask:
        """Nodes with the foot in contact."""
        return np.asarray(np.isfinite(self.com_m[:, 0]))


@reproduces("fig-4.9", "The CoM over the right foot, with and without the log-density", printed=("shares",))
def run(seeds: range, tell: Progress) -> Reproduction:
    """Deterministic."""
    paths: list[ComPath] = []
    for number, (measure, case) in enumerate((m, c) for m in MEASURES for c in CASES):
        tell(number / 4.0, f"{measure} densities, {case} the log-density")
        paths.append(com_path(measure, case))
    mixtures = {measure: load_proxies(ROBOT, measure)[FOOT].mixture for measure in MEASURES}
    return Reproduction(
        claims=figure_claims(paths),
        note="Experiment 2 of HRP-2 (six stairs of 10 cm in 24 s), the CoM in the frame of the right foot while in "
        "contact. Densities of uniform postures, as in the thesis, and conditioned on standing. The plan without the "
        "log-densities differs only in their weight, which is zero. Both keep the CoM "
        f"{COM_HEIGHT_M[0]:g} to {COM_HEIGHT_M[1]:g} m above the soles: without any bound of the height a plan without "
        "densities leaves every reach, which would say nothing about the densities.",
        tables={"shares": path_table(paths), "paths": path_columns(paths)},
        drawing=render_svg(
            *(
                path_panel(mixtures[m], [p for p in paths if p.measure == m], m, view)
                for m in MEASURES
                for view in VIEWS
            )
        ),
    )


def com_path(measure: Measure, case: str) -> ComPath:
    """Path of one plan in the frame of the foot."""
    stairs = replace(experiment_problem(2, ROBOT, measure), bounds=PathBounds(com_height_m=COM_HEIGHT_M))
    if case == "without":
        stairs = replace(stairs, weights=replace(stairs.weights, likelihood=0.0))
    return com_in_foot_frame(solve(stairs), stairs.proxies[FOOT].mixture, measure, case)


def com_in_foot_frame(plan: CentroidalPlan, mixture: Mixture, measure: Measure, case: str) -> ComPath:
    """CoM of a plan at the start of every interval in the frame of the foot's contact."""
    time_s, com_m = plan.time_s[:-1], np.full((len(plan.phase), 3), np.nan)
    for k, i in enumerate(plan.phase):
        contact = plan.sequence.phases[i].contacts.get(FOOT)
        if contact is not None:
            com_m[k] = contact.placement.inverse().act(plan.com_m[k : k + 1])[0]
    in_contact = np.isfinite(com_m[:, 0])
    share, log_density = np.full(len(com_m), np.nan), np.full(len(com_m), np.nan)
    share[in_contact] = usual_share(mixture, com_m[in_contact])
    log_density[in_contact] = mixture.log_density(com_m[in_contact])
    return ComPath(measure, case, time_s, com_m, share, log_density, plan.solver)


def figure_claims(paths: list[ComPath]) -> tuple[Claim, ...]:
    """Claims of 4.6.3 on the figure, for uniform and conditioned densities."""
    made: list[Claim] = []
    for measure in MEASURES:
        with_density, without_density = (
            next(p for p in paths if (p.measure, p.case) == (measure, case)) for case in CASES
        )
        gain = float(np.nanmean(with_density.log_density) - np.nanmean(without_density.log_density))
        outside_share = [float((p.share[p.in_contact] < RARE_SHARE).mean()) for p in (with_density, without_density)]
        made += [
            Measured(f"nearer_{measure}", "> 0", gain, "1", above(0.0, "words")).says(
                f"the CoM stays in the most feasible region, closer to the maxima ({measure} densities)",
                "Increase of the mean log-density of the right foot, in nats.",
                solver=with_density.solver,
                comparator="the plan without it",
            ),
            Measured(
                f"infeasible_{measure}",
                "infeasible",
                outside_share[1],
                "1",
                above(max(0.5, outside_share[0]), "ours"),
            ).says(
                f"without the log-density, the CoM tends to be infeasible ({measure} densities)",
                f"Share of the time outside the smallest set with {MASS:.0%} of the foot's density; with the "
                f"log-density {outside_share[0]:.2f}. Both are bounded in height: without that bound the plan without "
                "the log-density rises out of every reach, by the bound that it lacks.",
                solver=with_density.solver,
                comparator="the plan with it",
            ),
        ]
    conditioned = next(p for p in paths if (p.measure, p.case) == ("conditioned", "with"))
    least = float(conditioned.share[conditioned.in_contact].min())
    made.append(
        target("usual", least, "1", at_least=0.01).says(
            "with conditioned densities, least likely CoM of the plan: mass with lower density",
            solver=conditioned.solver,
        )
    )
    return tuple(made)


def path_table(paths: list[ComPath]) -> Mapping[str, Column]:
    """One row per plan."""
    return {
        "densities": np.array([p.measure for p in paths]),
        "log_density_in_cost": np.array([p.case for p in paths]),
        "mean_log_density": np.array([float(np.nanmean(p.log_density)) for p in paths]),
        "least_share": np.array([float(np.nanmin(p.share)) for p in paths]),
        "median_share": np.array([float(np.nanmedian(p.share)) for p in paths]),
        "lowest_m": np.array([float(np.nanmin(p.com_m[:, 2])) for p in paths]),
        "highest_m": np.array([float(np.nanmax(p.com_m[:, 2])) for p in paths]),
    }


def path_columns(paths: list[ComPath]) -> Mapping[str, Column]:
    """All paths at their nodes, including nodes without contact."""
    by_name: dict[str, Column] = {"time_s": paths[0].time_s}
    for p in paths:
        by_name |= {f"{p.measure}_{p.case}_{axis}_m": p.com_m[:, k] for k, axis in enumerate("xyz")}
    return by_name


VIEWS: Final = ((0, 1), (0, 2))
"""Axes of the foot's frame: top view, side view."""


def path_panel(mixture: Mixture, paths: list[ComPath], measure: str, view: tuple[int, int]) -> Panel:
    """Both paths over the level sets of the projected density with the masses ``LEVELS``."""
    flat = project_mixture(mixture, view)
    x, y, density = density_on_grid(flat, np.vstack([p.com_m[p.in_contact] for p in paths])[:, list(view)])
    falling = np.sort(density.ravel())[::-1]
    held = np.cumsum(falling) / falling.sum()
    curves = []
    for mass in LEVELS:
        level = float(falling[np.searchsorted(held, mass)])
        gap = np.full((1, 2), np.nan)
        outlines = [np.vstack([line, gap]) for line in find_contours(density, level)]  # type: ignore[no-untyped-call]
        rows, places = np.vstack(outlines).T
        curves.append(
            Curve(
                np.interp(places, np.arange(GRID), x), np.interp(rows, np.arange(GRID), y), f"{mass:.0%} of p", 6, True
            )
        )
    curves += [Curve(p.com_m[:, view[0]], p.com_m[:, view[1]], f"{p.case} it", k) for k, p in enumerate(paths)]
    names = "xyz"
    title = f"{measure}: CoM over the right foot, {names[view[0]]} and {names[view[1]]}"
    return Panel(title, f"{names[view[0]]} (m)", f"{names[view[1]]} (m)", curves)


Flat = tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k 2"], Float[np.ndarray, "k 2 2"]]
"""Weights, means and covariances in a plane."""


def project_mixture(mixture: Mixture, view: tuple[int, int]) -> Flat:
    """Marginal density of two coordinates."""
    axes = np.array(view)
    return mixture.weights, mixture.means_m[:, axes], mixture.covariances_m2[:, axes[:, None], axes]


def density_on_grid(
    projected: Flat, path_m: Float[np.ndarray, "_ 2"]
) -> tuple[Series, Series, Float[np.ndarray, "h w"]]:
    """Axes and values of the density on a grid that covers the density and the paths."""
    weights, means, covariances = projected
    sd = np.sqrt(np.einsum("kii->ki", covariances))
    low = np.minimum((means - 3 * sd).min(axis=0), path_m.min(axis=0) - MARGIN_M)
    high = np.maximum((means + 3 * sd).max(axis=0), path_m.max(axis=0) + MARGIN_M)
    x, y = (np.linspace(low[a], high[a], GRID) for a in range(2))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    density = np.zeros((GRID, GRID))
    for w, mu, S in zip(weights, means, covariances, strict=True):
        difference = points - mu
        squares = np.einsum("hwa,ab,hwb->hw", difference, np.linalg.inv(S), difference)
        density += w * np.exp(-0.5 * squares) / np.sqrt(np.linalg.det(S))
    return x, y, density
