"""Input and summary of ``sweep``: plans a scenario for a grid of parameter values."""

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.methods import NODE_RATE_HZ, Formulation
from stridelab.schemas.scenarios import Scenario, ScenarioSource

SweepField = Literal["stride", "height", "timing", "friction"]
SweepOutcome = Literal["feasible", "refused", "infeasible", "failed"]
MAX_POINTS: Final = 10_000
"""Maximum number of scenarios in one sweep."""
MAX_BODY_POINTS: Final = 500
"""Maximum number of scenarios in one sweep of the whole body, which takes some seconds for each."""
SweepScope = Literal["centre of mass", "whole body"]
"""Extent of the plans: the centroidal motion only, or also the whole body that follows it."""
SweepValue = Annotated[float, Field(gt=0.0, le=100.0)]


class SweepInput(ScenarioSource):
    """Input of ``sweep``: either a stored scenario or a complete one, and one to three fields to vary.

    ``vary`` maps a field to ``[from, to, number]``; every combination of the values is planned. ``stride`` and
    ``height`` are the maximum stride length and the maximum rise of a foot, in metres; ``timing`` is a factor on all
    durations, ``friction`` the coefficient of all surfaces. With ``whole_body``, the whole body follows each plan, and
    the certificate decides on feasibility; otherwise, the result concerns the centre of mass only. The other fields
    are those of ``plan-motion``.
    """

    vary: Annotated[
        dict[SweepField, tuple[SweepValue, SweepValue, Annotated[int, Field(ge=1, le=MAX_POINTS)]]],
        Field(min_length=1, max_length=3),
    ]
    formulation: Formulation = "forces"
    solver: Literal["auto", "native", "casadi", "ipopt", "fatrop"] = "auto"
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0
    measure: Literal["uniform", "conditioned"] | None = None
    whole_body: bool = False

    @model_validator(mode="after")
    def _check_points(self) -> "SweepInput":
        if self.points > MAX_POINTS:
            raise ValueError(f"vary: {self.points} scenarios are more than {MAX_POINTS}")
        if self.whole_body and self.points > MAX_BODY_POINTS:
            raise ValueError(f"vary: {self.points} scenarios are more than {MAX_BODY_POINTS}, the most with whole_body")
        return self

    @property
    def points(self) -> int:
        """Number of scenarios."""
        n = 1
        for _, _, number in self.vary.values():
            n *= number
        return n


class SweepAxis(Contract):
    """A varied field; ``present`` is its value in the original scenario."""

    field: SweepField
    unit: str
    values: list[float]
    present: float


class SweepSummary(Contract):
    """Summary of ``sweep``: number of scenarios per outcome, for the extent ``scope``.

    ``refused``: rejected by the validation, without a call of the solver; ``infeasible``: the solver has no solution,
    or the whole body cannot follow it, or the certificate fails; ``failed``: an error, or a crashed process.
    ``solvers`` counts the scenarios per solver; ``solve_time_s`` is the processor time of all solvers.
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


class SweepTask(Contract):
    """Task of ``sweep``, with the resolved scenario."""

    scenario: Scenario
    input: SweepInput
