"""What the report says: texts and curves that HTML and PDF show alike.

A value that was not measured has no text but a reason.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from stridelab.measures.gait_cycle import CurveName
from stridelab.pipelines.gait_report.logo import Logo
from stridelab.schemas.service import Language

Label = Literal["left", "right", "reference"]


@dataclass(frozen=True)
class Tile:
    """One value of the headline; without a value, ``reason`` is the reason."""

    name: str
    title: str
    value: str = ""
    interval: str = ""
    sides: str = ""
    symmetry: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Curve:
    """Mean over the cycle in millimetres and its standard deviation; NaN where it is not defined."""

    label: Label
    n: int
    mean: Float[np.ndarray, "101"]
    sd: Float[np.ndarray, "101"] | None


@dataclass(frozen=True)
class Panel:
    """One chart; without curves no cycle is measured."""

    name: CurveName
    title: str
    caption: str
    curves: tuple[Curve, ...]
    reference: Curve | None


@dataclass(frozen=True)
class Cell:
    """Mean, standard deviation between the steps, 95 % interval and number of steps; empty where not known."""

    mean: str
    sd: str
    interval: str
    n: int


@dataclass(frozen=True)
class Row:
    """One measure of the table; a side without a cell is not measured.

    ``difference`` and ``z`` are those to the reference group.
    """

    name: str
    title: str
    unit: str
    left: Cell | None
    right: Cell | None
    both: Cell | None
    symmetry: str = ""
    reference: Cell | None = None
    difference: str = ""
    difference_interval: str = ""
    z: str = ""
    z_interval: str = ""


@dataclass(frozen=True)
class Change:
    """One measure before and after."""

    name: str
    title: str
    unit: str
    before: str
    after: str
    change: str
    interval: str


@dataclass(frozen=True)
class TrialRow:
    """One recording that was measured."""

    filename: str
    recorded_on: str
    steps: str
    speed: str
    method: str
    verdict: str
    note: str


@dataclass(frozen=True)
class ReportContent:
    """The report. Pairs are of a name and its text."""

    language: Language
    title: str
    lab_name: str
    logo: Logo | None
    created_on: str
    version: str
    verdict: str
    verdict_note: str
    cautions: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]
    tiles: tuple[Tile, ...]
    panels: tuple[Panel, ...]
    panel_note: str
    rows: tuple[Row, ...]
    table_note: str
    reference_note: str
    changes: tuple[Change, ...]
    change_note: str
    missing: tuple[tuple[str, str], ...]
    left_out: tuple[tuple[str, str], ...]
    remarks: tuple[str, ...]
    trials: tuple[TrialRow, ...]
    settings: tuple[tuple[str, str], ...]
    references: tuple[str, ...]

    @property
    def is_compared(self) -> bool:
        """Whether the table has the columns of a reference group."""
        return any(row.reference is not None for row in self.rows)
