"""How the rolling wheel is written on the pages: its parameters, the models beside it, flags in sentences."""

from dataclasses import dataclass
from typing import Final

from stridelab_web.words import words


@dataclass(frozen=True)
class Parameter:
    """A parameter of (3.1) and (3.2): its name in the interface, its letter, and how it is shown."""

    key: str
    letter: str
    said: str
    unit: str
    factor: float
    digits: int

    @property
    def title(self) -> str:
        """Title of an axis."""
        return f"{self.letter} [{self.unit}]"

    @property
    def sd_key(self) -> str:
        """``R_m`` has its deviation in ``R_sd_m``: the unit stays at the end."""
        letter, _, unit = self.key.partition("_")
        return f"{letter}_sd_{unit}"

    def text(self, value: float | None) -> str:
        """``value`` in the shown unit; a dash where there is none."""
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
    "path": ("As a path", "Height as a function of the way ahead; vertical errors only."),
    "time": ("As a clock", "Ahead and up as functions of time; the wheel turns evenly."),
}
FLAGS: Final = {
    "path-not-converged": "The fit of the path did not settle within its iterations.",
    "r-too-large": "r exceeds 10 cm: nobody's centre of mass goes up and down by 20 cm in a walk.",
    "r-too-small": "r is below a millimetre: the centre of mass hardly goes up and down.",
    "part-of-a-turn": "The wheel does less than three quarters of a turn in this step.",
    "far-from-the-wheel": "The path keeps more than 4 mm from the wheel on average: this is no curtate cycloid.",
    "backwards": "R is negative: the walk goes against the direction that was found.",
    "not-curtate": "r is not between zero and R: the curve is no curtate cycloid.",
    "theta-not-monotone": "The angle does not increase throughout: the wheel would have to roll back.",
    "timed-omega-low": (
        "A wheel that turns evenly stops at the lowest angular velocity allowed: the step has another clock."
    ),
    "timed-omega-high": (
        "A wheel that turns evenly stops at the highest angular velocity allowed: the step has another clock."
    ),
}


def flag(code: str) -> str:
    """What a flag of a step means."""
    return FLAGS.get(code, words(code).capitalize() + ".")


def model(code: str) -> str:
    """Name of a curve that is held beside the wheel."""
    return MODELS.get(code, words(code))
