"""What a file says of the person. Names are never read; fillers and absurd values are dropped with a remark."""

import math
from collections.abc import Mapping

from stridelab.recordings.recording import Remark, Sex, Subject

HEIGHT_RANGE_M = (0.4, 2.6)
MASS_RANGE_KG = (2.0, 400.0)
WIDTH_RANGE_M = (0.03, 0.25)
WIDTH_JOINTS = ("knee", "ankle", "elbow")
AGE_RANGE_YEARS = (0.5, 98.0)
"""99 years is what several programs write where the age is not known."""


def read_subject(stated: Mapping[str, float]) -> tuple[Subject, tuple[Remark, ...]]:
    """Subject from ``stated`` values: height, mass (or weight, bodymass), age, gender; any case, any unit of length.

    Heights above 3 are taken for centimetres (below 300) or millimetres. ``gender`` is 0 for a woman, 1 for a man.
    """
    values = {key.lower().replace(" ", "").replace("_", ""): value for key, value in stated.items()}
    remarks: list[Remark] = []

    def pick(names: tuple[str, ...], what: str, limits: tuple[float, float]) -> float | None:
        for name in names:
            value = values.get(name)
            if value is None or math.isnan(value):
                continue
            if what == "height" and value > 3.0:
                value = value / 100.0 if value < 300.0 else value / 1000.0
            if limits[0] <= value <= limits[1]:
                return round(value, 4)
            remarks.append(
                Remark("filler-in-subject", f"The {what} in the file ({value:g}) is no real value; it is not used.")
            )
        return None

    height_m = pick(("height", "bodyheight"), "height", HEIGHT_RANGE_M)
    mass_kg = pick(("weight", "bodymass", "mass", "bodyweight"), "mass", MASS_RANGE_KG)
    age_years = pick(("age",), "age", AGE_RANGE_YEARS)
    gender = values.get("gender", values.get("sex"))
    sex: Sex | None = None
    if gender is not None and gender in (0.0, 1.0):
        sex = "male" if gender == 1.0 else "female"
    return Subject(height_m, mass_kg, sex, age_years), tuple(remarks)


def read_joint_widths_m(stated: Mapping[str, float]) -> dict[str, float]:
    """Calliper widths of a Plug-in Gait file ("LKneeWidth" in mm) as {"l_knee": metres}; absurd ones are left out."""
    values = {key.lower(): value for key, value in stated.items()}
    found = {
        f"{side}_{joint}": values.get(f"{side}{joint}width", math.nan) / 1000.0
        for side in "lr"
        for joint in WIDTH_JOINTS
    }
    return {name: width for name, width in found.items() if WIDTH_RANGE_M[0] <= width <= WIDTH_RANGE_M[1]}
