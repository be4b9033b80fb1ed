"""The curves of a plan: centre of mass, angular momentum and the force on each effector."""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from stridelab.schemas.scenarios import Scenario
from stridelab_web.plots import Reading, Row, Style, Trace, drawing, three
from stridelab_web.tables import Columns

CENTROIDAL_TABLE: Final = "centroidal.parquet"

_COM = ("com_x_m", "com_y_m", "com_z_m")
_VELOCITY = ("com_vx_m_s", "com_vy_m_s", "com_vz_m_s")
_MOMENTUM = ("l_x_nms", "l_y_nms", "l_z_nms")


def plan_curves(columns: Columns, scenario: Scenario) -> dict[str, Any]:
    """What the plots need of a ``centroidal`` table; phases with a foot in the air are shaded."""
    forces = vertical_forces(columns)
    shown: dict[str, np.ndarray] = {**columns, **{f"{name}_fz_n": force for name, force in forces.items()}}
    decimals = dict.fromkeys(_COM, 5) | dict.fromkeys(_VELOCITY, 4) | dict.fromkeys(_MOMENTUM, 3)
    decimals |= {f"{name}_fz_n": 1 for name in forces}
    rows = [
        *(Row(f"CoM {axis} [m]", (Trace(key, "plan", "main"),)) for axis, key in zip("xyz", _COM, strict=True)),
        three("Velocity [m/s]", _VELOCITY),
        three("Angular momentum [N m s]", _MOMENTUM),
        Row(
            "Vertical force [N]",
            tuple(Trace(f"{name}_fz_n", name.replace("_", " "), _style(name)) for name in forces),
            legend=True,
        ),
    ]
    readings = [Reading(axis, key, "m", 4) for axis, key in zip("xyz", _COM, strict=True)]
    readings += [Reading(name.replace("_", " "), f"{name}_fz_n", "N", 0) for name in forces]
    return drawing(shown, decimals, rows, readings, in_the_air_s(scenario))


def vertical_forces(columns: Columns) -> Mapping[str, np.ndarray]:
    """Vertical force on each effector: the sum over its contact points ``f_<effector>_<k>_z_n``."""
    found: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        if name.startswith("f_") and name.endswith("_z_n"):
            effector = name.removeprefix("f_").removesuffix("_z_n").rpartition("_")[0]
            found[effector] = found.get(effector, np.zeros_like(values)) + np.nan_to_num(values)
    return found


def in_the_air_s(scenario: Scenario) -> list[tuple[float, float]]:
    """Intervals in which one of the scenario's feet touches nothing."""
    feet = {c.effector for phase in scenario.phases for c in phase.contacts if "foot" in c.effector}
    found, start_s = [], 0.0
    for phase in scenario.phases:
        end_s = start_s + phase.duration_s
        if feet - {contact.effector for contact in phase.contacts}:
            found.append((start_s, end_s))
        start_s = end_s
    return found


def _style(effector: str) -> Style:
    if "hand" in effector:
        return "hand"
    return "left" if effector.startswith("left") else "right"
