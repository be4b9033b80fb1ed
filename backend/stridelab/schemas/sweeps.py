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
BODIES_AT_MOST: Final = 500
"""Scenarios of one sweep of the whole body, which takes some seconds for each."""
SweepScope = Literal["centre of mass", "whole body"]
"""What was planned: the centroidal motion alone, or also the body that follows it."""
SweepValue = Annotated[float, Field(gt=0.0, le=100.0)]


class SweepInput(Contract):
    """Input of ``sweep``: a stored scenario or a whole one, never both, and one to three fields to vary.

    ``vary`` maps a field to ``[from, to, number]``; every combination of the values is planned. ``stride`` and
    ``height`` are the longest way and the greatest rise of a foot between two of its places, in metres; ``timing`` is a
    factor on all durations, ``friction`` the coefficient of all surfaces. With ``whole_body``, the body follows every
    plan that is found, and its certificate decides; without it, the answer is about the centre of mass alone. The
    other fields are those of ``plan-motion``.
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
    whole_body: bool = False

    @model_validator(mode="after")
    def _whole(self) -> "SweepInput":
        if (self.scenario_id is None) == (self.scenario is None):
            raise ValueError("give either scenario_id or scenario")
        if self.points > POINTS_AT_MOST:
            raise ValueError(f"vary: {self.points} scenarios are more than {POINTS_AT_MOST}")
        if self.whole_body and self.points > BODIES_AT_MOST:
            raise ValueError(f"vary: {self.points} scenarios are more than {BODIES_AT_MOST}, the most with whole_body")
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
    """Summary of ``sweep``: how many scenarios have a motion of what ``scope`` names.

    ``refused`` by the judge, before any solver; ``infeasible``: the solver found no motion, or, with the whole body,
    the body cannot follow it or its certificate fails; ``failed``: an error, or a process that died. ``solvers`` counts
    the solver that served; ``solve_time_s`` is processor time of all solvers.
    """

    scenario_name: str
    robot: str
    scope: SweepScope = "centre of mass"
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
