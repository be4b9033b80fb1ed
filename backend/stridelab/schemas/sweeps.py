"""Input and summary of ``sweep``: one scenario at many values of a few numbers, each planned or refused."""

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.plans import NODE_RATE_HZ, Formulation
from stridelab.schemas.scenarios import Scenario

SweepField = Literal["stride", "height", "timing", "friction"]
SweepOutcome = Literal["feasible", "refused", "infeasible", "failed"]
POINTS_AT_MOST: Final = 10_000
"""Scenarios of one sweep."""
SweepValue = Annotated[float, Field(gt=0.0, le=100.0)]


class SweepInput(Contract):
    """Input of ``sweep``: a stored scenario or a whole one, never both, and one to three fields to vary.

    ``vary`` maps a field to ``[from, to, number]``; every combination of the values is planned. ``stride`` and
    ``height`` are the longest way and the greatest rise of a foot between two of its places, in metres; ``timing`` is a
    factor on all durations, ``friction`` the coefficient of all surfaces. The other fields are those of
    ``plan-motion``.
    """

    scenario_id: str | None = None
    scenario: Scenario | None = None
    vary: Annotated[
        dict[SweepField, tuple[SweepValue, SweepValue, Annotated[int, Field(ge=1, le=POINTS_AT_MOST)]]],
        Field(min_length=1, max_length=3),
    ]
    formulation: Formulation = "forces"
    solver: Literal["auto", "native", "casadi", "ipopt", "fatrop"] = "auto"
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0
    measure: Literal["uniform", "conditioned"] | None = None

    @model_validator(mode="after")
    def _whole(self) -> "SweepInput":
        if (self.scenario_id is None) == (self.scenario is None):
            raise ValueError("give either scenario_id or scenario")
        if self.points > POINTS_AT_MOST:
            raise ValueError(f"vary: {self.points} scenarios are more than {POINTS_AT_MOST}")
        return self

    @property
    def points(self) -> int:
        """How many scenarios it comes to."""
        n = 1
        for _, _, number in self.vary.values():
            n *= number
        return n


class SweepAxis(Contract):
    """A field that was varied; ``present`` is what the scenario itself has."""

    field: SweepField
    unit: str
    values: list[float]
    present: float


class SweepSummary(Contract):
    """Summary of ``sweep``: how many scenarios have a motion.

    ``refused`` by the judge, before any solver; ``infeasible``: the solver found no motion; ``failed``: an error, or a
    process that died. ``solvers`` counts the solver that served; ``solve_time_s`` is processor time of all solvers.
    """

    scenario_name: str
    robot: str
    axes: list[SweepAxis]
    points: int
    feasible: int
    refused: int
    infeasible: int
    failed: int
    solvers: dict[str, int]
    solver_because: str | None = None
    solve_time_s: float
    wall_time_s: float
    processes: int
    warnings: list[Remark]
