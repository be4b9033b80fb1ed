"""Figures 3.7 to 3.9: R and r, z0, and omega versus body height."""

from typing import Final

from stridelab.conventions import Progress
from stridelab.reproduction.claims import Claim, Reproduction, reproduces
from stridelab.reproduction.common.simulated_people import (
    MIN_SEEDS,
    NOTE,
    PEOPLE_PER_SEED,
    THESIS_SUBJECTS,
    SimulatedPeople,
    height_claim,
    height_plot_curves,
    people_table,
    simulated_people,
)
from stridelab.reproduction.report.svg_plots import Panel, render_svg

DEFAULT_SEEDS: Final = THESIS_SUBJECTS // PEOPLE_PER_SEED


@reproduces("fig-3.7", "R and r against the height", draws="many", default_seeds=DEFAULT_SEEDS, min_seeds=MIN_SEEDS)
def radii(seeds: range, tell: Progress) -> Reproduction:
    """Simulated subjects, ``PEOPLE_PER_SEED`` of each seed."""
    people = simulated_people(seeds, tell)
    return _height_figure(
        people,
        (height_claim(people, "R_m", "R", "r = 0.67"), height_claim(people, "r_m", "r", "r = 0.61")),
        Panel("Radius of the wheel", "height (m)", "R (mm)", height_plot_curves(people, "R_m", 1e3, 0, "R")),
        Panel("Distance of the point", "height (m)", "r (mm)", height_plot_curves(people, "r_m", 1e3, 1, "r")),
    )


@reproduces("fig-3.8", "z0 against the height", draws="many", default_seeds=DEFAULT_SEEDS, min_seeds=MIN_SEEDS)
def hub_height(seeds: range, tell: Progress) -> Reproduction:
    """Simulated subjects, ``PEOPLE_PER_SEED`` of each seed."""
    people = simulated_people(seeds, tell)
    curves = height_plot_curves(people, "z0_m", 1.0, 0, "z0")
    claims = (height_claim(people, "z0_m", "z0", "r = 0.87"),)
    return _height_figure(people, claims, Panel("Height of the hub", "height (m)", "z0 (m)", curves))


@reproduces(
    "fig-3.9",
    "Angular velocity against the height",
    draws="many",
    default_seeds=DEFAULT_SEEDS,
    min_seeds=MIN_SEEDS,
)
def angular_velocity(seeds: range, tell: Progress) -> Reproduction:
    """Simulated subjects, ``PEOPLE_PER_SEED`` of each seed."""
    people = simulated_people(seeds, tell)
    claim = height_claim(people, "omega_rad_s", "omega", "p of 0.83 or more")
    curves = height_plot_curves(people, "omega_rad_s", 1.0, 0, "omega")
    return _height_figure(people, (claim,), Panel("Angular velocity", "height (m)", "omega (rad/s)", curves))


def _height_figure(people: SimulatedPeople, claims: tuple[Claim, ...], *panels: Panel) -> Reproduction:
    return Reproduction(claims, NOTE, {"people": people_table(people)}, render_svg(*panels))
