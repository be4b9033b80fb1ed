"""The curves of a plan, or of two: centre of mass, angular momentum and the force on each effector."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from stridelab.schemas.scenarios import Scenario
from stridelab_web.charts.plotly import Reading, Row, Style, Trace, plot_document, xyz_row
from stridelab_web.parquet import Columns
from stridelab_web.scene.plan_frames import com_m

CENTROIDAL_TABLE: Final = "centroidal.parquet"
REPLAY_TABLE: Final = "replay.parquet"
REPLAY_HZ: Final = 50.0
"""Sampling rate of the drawn replay."""

_COM = ("com_x_m", "com_y_m", "com_z_m")
_VELOCITY = ("com_vx_m_s", "com_vy_m_s", "com_vz_m_s")
_MOMENTUM = ("l_x_nms", "l_y_nms", "l_z_nms")

OTHER: Final = "other_"
"""Prefix of the columns of the second plan or of the replay."""
REPLAYED: Final = "replay"
_FULL: Final[Sequence[Style]] = ("full1", "full2", "full3", "full4")
_DASHED: Final[Sequence[Style]] = ("dashed1", "dashed2", "dashed3", "dashed4")
_SAME_S: Final = 1e-9


def plan_curves(columns: Columns, scenario: Scenario, *, steps: bool = True) -> dict[str, Any]:
    """Plot document of a ``centroidal`` table; phases with a foot in the air are shaded.

    With ``steps`` forces are constant between nodes, else they are splines.
    """
    forces = vertical_forces(columns)
    shown: dict[str, np.ndarray] = {**columns, **{f"{name}_fz_n": force for name, force in forces.items()}}
    decimals = dict.fromkeys(_COM, 5) | dict.fromkeys(_VELOCITY, 4) | dict.fromkeys(_MOMENTUM, 6)
    decimals |= {f"{name}_fz_n": 1 for name in forces}
    rows = [
        *(Row(f"CoM {axis} [m]", (Trace(key, "plan", "main"),)) for axis, key in zip("xyz", _COM, strict=True)),
        xyz_row("Velocity [m/s]", _VELOCITY),
        xyz_row("Momentum L [N m s]", _MOMENTUM),
        Row(
            "Vertical force [N]",
            tuple(Trace(f"{name}_fz_n", name.replace("_", " "), _effector_style(name)) for name in forces),
            legend=True,
            steps=steps,
        ),
    ]
    readings = [Reading(axis, key, "m", 4) for axis, key in zip("xyz", _COM, strict=True)]
    readings += [Reading(name.replace("_", " "), f"{name}_fz_n", "N", 0) for name in forces]
    return plot_document(shown, decimals, rows, readings, in_the_air_s(scenario))


def pair_curves(first: Columns, second: Columns, scenario: Scenario, *, steps: bool = True) -> dict[str, Any]:
    """Plot document of two plans: ``first`` with full lines and shaded phases, ``second`` with dashed lines.

    Both are evaluated at the nodes of both, each only within its duration.
    """
    time_s = np.unique(np.concatenate([first["time_s"], second["time_s"]]).round(9))
    shown: dict[str, np.ndarray] = {"time_s": time_s}
    for before, columns in (("", first), (OTHER, second)):
        shown |= {f"{before}{name}": values for name, values in _values_at(columns, time_s).items()}
    forces = list(dict.fromkeys(name for each in (first, second) for name in vertical_forces(each)))
    decimals = dict.fromkeys(_COM, 5) | dict.fromkeys(_VELOCITY, 4) | dict.fromkeys(_MOMENTUM, 6)
    decimals |= {f"{name}_fz_n": 1 for name in forces}
    rows = [
        *(_paired_row(f"CoM {axis} [m]", {axis: key}, legend=False) for axis, key in zip("xyz", _COM, strict=True)),
        _paired_row("Velocity [m/s]", dict(zip("xyz", _VELOCITY, strict=True))),
        _paired_row("Momentum L [N m s]", dict(zip("xyz", _MOMENTUM, strict=True))),
        _paired_row("Vertical force [N]", {name.replace("_", " "): f"{name}_fz_n" for name in forces}, steps=steps),
    ]
    readings = [Reading(axis, key, "m", 4, more=(OTHER + key,)) for axis, key in zip("xyz", _COM, strict=True)]
    readings += [
        Reading(name.replace("_", " "), f"{name}_fz_n", "N", 0, more=(f"{OTHER}{name}_fz_n",)) for name in forces
    ]
    both = decimals | {OTHER + name: digits for name, digits in decimals.items()}
    return plot_document(shown, both, rows, readings, in_the_air_s(scenario))


def replayed_curves(columns: Columns, replay: Columns, scenario: Scenario, *, steps: bool = True) -> dict[str, Any]:
    """Plot document of a plan and, dashed, of the CoM and the forces on each effector in its replay in physics."""
    nodes_s = columns["time_s"]
    samples_s = np.arange(0.0, nodes_s[-1], 1.0 / REPLAY_HZ)
    time_s = np.unique(np.concatenate([nodes_s, samples_s]).round(9))
    shown: dict[str, np.ndarray] = {"time_s": time_s, **_values_at(columns, time_s)}
    forces = list(vertical_forces(columns))
    measured = dict(zip(_COM, _COM, strict=True)) | {f"{name}_fz_n": f"f_{name}_z_n" for name in forces}
    for name, column in measured.items():
        values = replay.get(column, np.full(len(replay["time_s"]), np.nan))
        shown[OTHER + name] = np.interp(time_s, replay["time_s"], values, left=np.nan, right=np.nan)
    decimals = dict.fromkeys(_COM, 5) | dict.fromkeys(_VELOCITY, 4) | dict.fromkeys(_MOMENTUM, 6)
    decimals |= {f"{name}_fz_n": 1 for name in forces}
    decimals |= {OTHER + name: decimals[name] for name in measured}
    com = [
        _paired_row(f"CoM {axis} [m]", {axis: key}, legend=False, second_name=REPLAYED)
        for axis, key in zip("xyz", _COM, strict=True)
    ]
    rows = [
        *com,
        xyz_row("Velocity [m/s]", _VELOCITY),
        xyz_row("Momentum L [N m s]", _MOMENTUM),
        _paired_row(
            "Vertical force [N]",
            {name.replace("_", " "): f"{name}_fz_n" for name in forces},
            steps=steps,
            second_name=REPLAYED,
        ),
    ]
    readings = [Reading(axis, key, "m", 4, more=(OTHER + key,)) for axis, key in zip("xyz", _COM, strict=True)]
    readings += [
        Reading(name.replace("_", " "), f"{name}_fz_n", "N", 0, more=(f"{OTHER}{name}_fz_n",)) for name in forces
    ]
    return plot_document(shown, decimals, rows, readings, in_the_air_s(scenario))


def _paired_row(
    title: str, named: Mapping[str, str], *, legend: bool = True, steps: bool = False, second_name: str = "other plan"
) -> Row:
    """Row with the curves of the first plan and, dashed in the same colours, those of the second."""
    traces: list[Trace] = []
    for k, (name, key) in enumerate(named.items()):
        full, dashed = _FULL[k % len(_FULL)], _DASHED[k % len(_DASHED)]
        traces += [Trace(key, name, full), Trace(OTHER + key, f"{name}, {second_name}", dashed, listed=False)]
    return Row(title, tuple(traces), legend=legend, steps=steps)


def _values_at(columns: Columns, time_s: np.ndarray) -> dict[str, np.ndarray]:
    """Drawn columns of a plan at ``time_s``, NaN after its end; forces are constant between nodes."""
    nodes_s = columns["time_s"]
    after_end = time_s > nodes_s[-1] + _SAME_S
    by_column = dict(zip(_COM, com_m(columns, time_s).T, strict=True))
    for key in (*_VELOCITY, *_MOMENTUM):
        if key in columns:
            by_column[key] = np.interp(time_s, nodes_s, columns[key])
    k = np.clip(np.searchsorted(nodes_s, time_s + _SAME_S, side="right") - 1, 0, len(nodes_s) - 1)
    by_column |= {f"{name}_fz_n": force[k] for name, force in vertical_forces(columns).items()}
    return {key: np.where(after_end, np.nan, values) for key, values in by_column.items()}


def vertical_forces(columns: Columns) -> Mapping[str, np.ndarray]:
    """Vertical force on each effector: the sum over its contact points ``f_<effector>_<k>_z_n``."""
    forces: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        if name.startswith("f_") and name.endswith("_z_n"):
            effector = name.removeprefix("f_").removesuffix("_z_n").rpartition("_")[0]
            forces[effector] = forces.get(effector, np.zeros_like(values)) + np.nan_to_num(values)
    return forces


def in_the_air_s(scenario: Scenario) -> list[tuple[float, float]]:
    """Intervals (s) in which one of the scenario's feet has no contact."""
    feet = {c.effector for phase in scenario.phases for c in phase.contacts if "foot" in c.effector}
    intervals_s, start_s = [], 0.0
    for phase in scenario.phases:
        end_s = start_s + phase.duration_s
        if feet - {contact.effector for contact in phase.contacts}:
            intervals_s.append((start_s, end_s))
        start_s = end_s
    return intervals_s


def _effector_style(effector: str) -> Style:
    if "hand" in effector:
        return "hand"
    return "left" if effector.startswith("left") else "right"
