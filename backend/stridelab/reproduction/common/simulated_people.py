"""Simulated subjects of different heights, used by the figures on a population.

Speeds are drawn independently of the height, so that correlations with the height result from geometric similarity of
the bodies and not from prescribed gait differences.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from stridelab.conventions import Series
from stridelab.recordings.recording import Sex
from stridelab.reproduction.claims import Claim, target
from stridelab.reproduction.common.accepted_draws import own_seeds
from stridelab.reproduction.common.simulated_steps import true_steps
from stridelab.reproduction.report.svg_plots import Curve
from stridelab.simulation.human.walker import HumanWalker
from stridelab.simulation.human_recording import record
from stridelab.simulation.noise import MeasurementNoise
from stridelab.walking.population.population import PARAMETERS, Pair, Person, Population, StepRow, study
from stridelab.walking.step_fit import StepFit, fit_step

HEIGHT_M: Final[dict[Sex, tuple[float, float]]] = {"male": (1.74, 0.04), "female": (1.71, 0.04)}
"""Mean and standard deviation of the thesis' subjects (3.2.1), a quarter of whom were women."""
SPEED_M_S: Final = (1.25, 0.12)
PEOPLE_PER_SEED: Final = 4
"""With 200 subjects the interval of a correlation of 0.3 ends below 0.5 in nine samples of ten, with 50 in four."""
MIN_SEEDS: Final = 2
"""Fewer than eight subjects do not give a meaningful correlation."""
THESIS_SUBJECTS: Final = 16
DURATION_S: Final = 3.0
NOTE: Final = (
    "Simulated subjects with exact centre of mass, with the heights of the thesis' subjects, at speeds drawn "
    "independently of the height. The simulated vertical motion is a cosine per step by construction: these "
    "correlations are properties of the simulation and no verdict on the thesis; people are in the "
    "items whose names end in -people, and in docs/theory/population.md."
)
PEOPLE_NOTE: Final = "No verdict on the thesis: people are in the items whose names end in -people."
INDEPENDENT_R: Final = 0.5
"""Largest correlation with the height of a parameter that geometric similarity leaves alone."""


@dataclass(frozen=True)
class SimulatedPeople:
    """The analysed population, and all step fits by subject."""

    population: Population
    fits: dict[str, tuple[StepFit, ...]]


@lru_cache(maxsize=2)
def _simulate_people(seeds: range) -> SimulatedPeople:
    rng = np.random.default_rng(3 + seeds[0])
    people, rows, fits = [], [], {}
    for i, seed in enumerate(seeds):
        sex: Sex = "female" if i % 4 == 3 else "male"
        name, height_m = f"person {i + 1}", float(rng.normal(*HEIGHT_M[sex]))
        speed_m_s = float(rng.normal(*SPEED_M_S))
        own = _simulate_and_fit(height_m, sex, speed_m_s, seed)
        people.append(Person(name=name, group="adults", height_m=height_m))
        rows += [StepRow(name, name, parameter_values(fit)) for fit in own]
        fits[name] = own
    return SimulatedPeople(study(people, rows), fits)


def simulated_people(seeds: range, tell: Callable[[float, str], None]) -> SimulatedPeople:
    """Simulate ``PEOPLE_PER_SEED`` subjects per seed."""
    own = own_seeds(seeds, PEOPLE_PER_SEED)
    tell(0.05, f"simulating {len(own)} subjects")
    people = _simulate_people(own)
    tell(0.9, "analysing the population")
    return people


def correlation_with_height(people: SimulatedPeople, parameter: str) -> Pair:
    """Correlation of a parameter with the height."""
    pairs = people.population.pairs
    return next(pair for pair in pairs if (pair.parameter, pair.against) == (parameter, "height_m"))


def height_claim(people: SimulatedPeople, parameter: str, letter: str, thesis: str) -> Claim:
    """How a parameter of simulated people follows the height, which is an aim of the simulation.

    Their gait does not depend on the height: only z0, a fraction of the stature, has to follow it.
    """
    pair = correlation_with_height(people, parameter).pearson
    key, note = f"{parameter.removesuffix('_m')}_height_r", f"The thesis has {thesis}. p = {pair.p:.2g}. {PEOPLE_NOTE}"
    if parameter == "z0_m":
        numbers, says = target(key, pair.r, "1", at_least=0.9), "follows the height of simulated subjects"
    else:
        numbers = target(key, pair.r, "1", at_least=-INDEPENDENT_R, at_most=INDEPENDENT_R)
        says = "does not follow the height of simulated subjects, whose gait does not depend on it"
    return numbers.says(f"{letter} {says}", note, n=pair.n, interval=pair.ci95)


def people_table(people: SimulatedPeople) -> dict[str, Series]:
    """One row per subject: height, speed, mean and standard deviation of every parameter."""
    subjects = people.population.subjects
    columns = {name: np.array([s.value(name) for s in subjects]) for name in ("height_m", "speed_m_s", *PARAMETERS)}
    return columns | {f"sd_{name}": np.array([s.sd[name] for s in subjects]) for name in PARAMETERS}


def height_plot_curves(
    people: SimulatedPeople, parameter: str, scale: float, colour: int = 0, letter: str = ""
) -> list[Curve]:
    """Error bars of a parameter for every subject, and the regression line."""
    heights = np.array([s.value("height_m") for s in people.population.subjects])
    means = scale * np.array([s.mean[parameter] for s in people.population.subjects])
    sds = scale * np.nan_to_num([s.sd[parameter] for s in people.population.subjects])
    gap = np.full_like(heights, np.nan)
    bars = Curve(
        np.column_stack([heights, heights, gap]).ravel(),
        np.column_stack([means - sds - 1e-6, means + sds + 1e-6, gap]).ravel(),
        f"{letter} of each subject, mean ± sd",
        colour,
    )
    ends = np.array([heights.min(), heights.max()])
    line = np.polyval(np.polyfit(heights, means, 1), ends)
    return [bars, Curve(ends, line, f"line of {letter}", colour, dashed=True)]


def _simulate_and_fit(height_m: float, sex: Sex, speed_m_s: float, seed: int) -> tuple[StepFit, ...]:
    mass_kg = 22.5 * height_m**2
    walker = HumanWalker(
        height_m=height_m, mass_kg=mass_kg, sex=sex, speed_m_s=speed_m_s, duration_s=DURATION_S, seed=seed
    )
    walk = walker.walk()
    truth = record(walk, MeasurementNoise(), 0, lab="walkway").truth
    path = np.asarray(truth.com_m[:, [0, 2]])
    fits = []
    for step in true_steps(walk):
        inside = (truth.time_s >= step.start_s) & (truth.time_s <= step.end_s)
        if inside.any() and truth.time_s[-1] >= step.end_s:
            own = replace(step, length_m=speed_m_s * step.period_s, speed_m_s=speed_m_s)
            fits.append(fit_step(own, truth.time_s[inside], path[inside]))
    return tuple(fits)


def parameter_values(fit: StepFit) -> dict[str, float]:
    """Values of one step for a population study."""
    distance_mm = 1e3 * fit.path.distance_m
    return {
        "R_m": fit.path.wheel.R_m,
        "r_m": fit.path.wheel.r_m,
        "z0_m": fit.path.wheel.z0_m,
        "omega_rad_s": fit.omega_rad_s,
        "speed_m_s": fit.step.speed_m_s,
        "step_length_m": float("nan") if fit.step.length_m is None else fit.step.length_m,
        "error_mean_mm": float(distance_mm.mean()),
        "error_sd_mm": float(distance_mm.std()),
    }
