"""The steps of a fit-cycloid result as text: parameters of the wheel, rival models, and flags."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Final

from stridelab.schemas.cycloid import FitCycloidSummary, FittedStep, Rival, StepScatter
from stridelab.translations.catalogue import gettext
from stridelab_web.formatting import code_words

MS = 1000.0
MAX_UNREPORTED_S = 0.015
"""Duration at the ends of a step that the fit may leave out without a notice: one or two samples."""


@dataclass(frozen=True)
class ValueRow:
    """One row of the table of a wheel, as text: the path with both deviations, and the other three fits."""

    key: str
    name: str
    value: str
    formal_sd: str
    scatter: str
    others: tuple[str, str, str]


@dataclass(frozen=True)
class Timing:
    """Start or end of double support: measured, and by the thesis' rule (3.3.3)."""

    name: str
    measured_s: float
    rule_s: float | None

    @property
    def error_ms(self) -> float | None:
        """The rule minus the measurement."""
        return None if self.rule_s is None else MS * (self.rule_s - self.measured_s)


@dataclass(frozen=True)
class Entrant:
    """One curve of a contest; ``best`` has the columns in which it is smallest, ``wins`` counts steps won by AIC."""

    rival: Rival
    name: str
    aic_above_best: float
    best: frozenset[str]
    wins: int


@dataclass(frozen=True)
class Contest:
    """All curves in one space."""

    space: str
    title: str
    hint: str
    entrants: tuple[Entrant, ...]


@dataclass(frozen=True)
class WheelStep:
    """A step with its number, from 0."""

    index: int
    fit: FittedStep

    @property
    def name(self) -> str:
        """Number from 1, and the foot that swings."""
        number = self.index + 1
        if self.fit.side == "left":
            return gettext("Step %(number)s, left foot swings", number=number)
        return gettext("Step %(number)s, right foot swings", number=number)

    @property
    def flag_sentences(self) -> tuple[str, ...]:
        """Flags of the step as sentences."""
        return tuple(flag_sentence(code) for code in self.fit.flags)

    @property
    def partly_fitted(self) -> bool:
        """Whether the fit left out a part of the step."""
        start_s, end_s = self.fit.fitted_s
        return start_s - self.fit.t0_s > MAX_UNREPORTED_S or self.fit.t1_s - end_s > MAX_UNREPORTED_S

    @property
    def timings(self) -> tuple[Timing, Timing]:
        """Start and end of double support."""
        measured, rule = self.fit.double_support_s, self.fit.double_support_model_s
        return (Timing("Start", measured[0], rule[0]), Timing("End", measured[1], rule[1]))

    def parameter_value(self, key: str) -> float:
        """Value of one of ``PARAMETERS``."""
        return float(getattr(self.fit, key))


def steps_of(summary: FitCycloidSummary) -> tuple[WheelStep, ...]:
    """The steps of a summary, in the order of time."""
    return tuple(WheelStep(k, fit) for k, fit in enumerate(sorted(summary.steps, key=lambda fit: fit.t0_s)))


def medians_of(steps: Sequence[WheelStep]) -> dict[str, float]:
    """Median over the steps of every parameter."""
    return {p.key: median(step.parameter_value(p.key) for step in steps) for p in PARAMETERS} if steps else {}


def values_of(step: WheelStep, scatter: StepScatter | None) -> tuple[ValueRow, ...]:
    """R, r, z0, omega and the distances of ``step``; ``scatter`` is the scatter between the steps of the recording."""
    fit = step.fit
    others = (fit.reversed, fit.timed, fit.reversed_timed)

    def parameter_row(p: Parameter) -> ValueRow:
        formal = getattr(fit.sd, p.key, None)
        between = None if scatter is None else getattr(scatter, p.key)
        a, b, c = (p.format_value(getattr(one, p.key)) for one in others)
        name = f"{p.letter}, {gettext(p.meaning)} [{p.unit}]"
        return ValueRow(
            p.key,
            name,
            p.format_value(step.parameter_value(p.key)),
            p.format_value(formal),
            p.format_value(between),
            (a, b, c),
        )

    def distance_row(key: str, name: str) -> ValueRow:
        a, b, c = (f"{getattr(one, key):.2f}" for one in others)
        return ValueRow(key, name, f"{getattr(fit, key):.2f}", "–", "–", (a, b, c))

    return (
        *(parameter_row(p) for p in PARAMETERS),
        distance_row("error_mean_mm", gettext("Distance, mean [mm]")),
        distance_row("error_max_mm", gettext("Distance, largest [mm]")),
    )


def contests_of(step: WheelStep, steps: Sequence[WheelStep]) -> tuple[Contest, ...]:
    """The models of ``step`` in path and in time, and how often each is the best of all ``steps``."""
    contests = []
    for space, (title, hint) in SPACES.items():
        rivals = _rivals_in_space(step, space)
        if rivals:
            wins = Counter(_best_model(one, space) for one in steps if _rivals_in_space(one, space))
            entrants = tuple(_make_entrant(one, rivals, wins[one.model]) for one in rivals)
            contests.append(Contest(space, gettext(title), gettext(hint), entrants))
    return tuple(contests)


def _make_entrant(one: Rival, rivals: Sequence[Rival], wins: int) -> Entrant:
    columns = ("rms_mm", "held_out_mm", "aic")
    smallest = {key: min(getattr(rival, key) for rival in rivals) for key in columns}
    best = frozenset(key for key, value in smallest.items() if getattr(one, key) == value)
    return Entrant(one, model_name(one.model), one.aic - smallest["aic"], best, wins)


def _rivals_in_space(step: WheelStep, space: str) -> list[Rival]:
    return [one for one in step.fit.rivals if one.space == space]


def _best_model(step: WheelStep, space: str) -> str:
    return min(_rivals_in_space(step, space), key=lambda one: one.aic).model


@dataclass(frozen=True)
class Parameter:
    """A parameter of (3.1) and (3.2): its name in the interface, its letter, and how it is shown."""

    key: str
    letter: str
    meaning: str
    unit: str
    factor: float
    digits: int

    @property
    def axis_title(self) -> str:
        """Title of an axis."""
        return f"{self.letter} [{self.unit}]"

    @property
    def sd_key(self) -> str:
        """``R_m`` has its deviation in ``R_sd_m``: the unit stays at the end."""
        letter, _, unit = self.key.partition("_")
        return f"{letter}_sd_{unit}"

    def format_value(self, value: float | None) -> str:
        """``value`` in the shown unit; a dash for None."""
        return "–" if value is None else f"{self.factor * value:z.{self.digits}f}"


PARAMETERS: Final = (
    Parameter("R_m", "R", "radius of the wheel", "mm", 1000.0, 1),
    Parameter("r_m", "r", "point from the hub", "mm", 1000.0, 1),
    Parameter("z0_m", "z₀", "height of the hub", "mm", 1000.0, 1),
    Parameter("omega_rad_s", "ω", "angular velocity", "rad/s", 1.0, 2),
)
MODELS: Final = {
    "sinusoid": "sinusoid",
    "two-harmonics": "two harmonics",
    "one-harmonic": "one harmonic (an ellipse)",
    "pendulum-arcs": "inverted-pendulum arcs",
    "wheel": "wheel, s = +1 (thesis)",
    "wheel-reversed": "wheel, s = −1",
}
SPACES: Final = {
    "path": ("As a path", "Height as a function of the distance ahead; vertical errors only."),
    "time": ("Over time", "Ahead and up as functions of time; the wheel turns uniformly."),
}
FLAGS: Final = {
    "path-not-converged": "The fit of the path did not converge within its iterations.",
    "r-too-large": "r exceeds 10 cm: no centre of mass moves up and down by 20 cm in a walk.",
    "r-too-small": "r is below a millimetre: the centre of mass hardly moves up and down.",
    "part-of-a-turn": "The wheel makes less than three quarters of a turn in this step.",
    "far-from-the-wheel": "The path is more than 4 mm from the wheel on average: it is not a curtate cycloid.",
    "backwards": "R is negative: the walk goes against the estimated direction.",
    "not-curtate": "r is not between zero and R: the curve is not a curtate cycloid.",
    "theta-not-monotone": "The angle does not increase throughout: the wheel would have to roll back.",
    "timed-omega-low": (
        "With uniform rotation the angular velocity is at its lower bound: the wheel does not turn uniformly."
    ),
    "timed-omega-high": (
        "With uniform rotation the angular velocity is at its upper bound: the wheel does not turn uniformly."
    ),
}


def flag_sentence(code: str) -> str:
    """Sentence of a flag of a step."""
    return gettext(FLAGS[code]) if code in FLAGS else code_words(code).capitalize() + "."


def model_name(code: str) -> str:
    """Name of a curve that is compared with the wheel."""
    return gettext(MODELS.get(code, code_words(code)))
