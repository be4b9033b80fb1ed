"""Input and result of ``reproduce``."""

from typing import Annotated, Literal

from pydantic import Field

from stridelab.schemas.base import Contract

ReproductionItem = Literal[
    "fig-2.2",
    "fig-2.5",
    "fig-2.6",
    "fig-2.7",
    "fig-2.8",
    "fig-2.9",
    "fig-3.3",
    "fig-3.4",
    "fig-3.5",
    "fig-3.6",
    "fig-3.7",
    "fig-3.8",
    "fig-3.9",
    "fig-3.10",
    "fig-4.2",
    "fig-4.3",
    "fig-4.4",
    "fig-4.5",
    "fig-4.6",
    "fig-4.7",
    "fig-4.8",
    "fig-4.9",
    "table-4.1",
    "numbers-2",
    "numbers-3",
    "numbers-4",
    "errors",
    "lag",
    "coverage",
    "partial-force",
    "flight",
]
"""A figure of the thesis, the numbers in the text of a chapter, or a table on the simulated walks."""
Verdict = Literal["met", "beaten", "not_met", "thesis_in_error"]
"""``met``: agrees with the thesis; ``beaten``: reaches an aim beyond the thesis; ``not_met``: neither."""


class ReproduceInput(Contract):
    """Input of ``reproduce``."""

    item: ReproductionItem
    seeds: Annotated[int, Field(ge=1, le=200)] | None = Field(
        default=None, description="number of simulated walks; null takes as many as fit into a minute, 50 is accurate"
    )


class ClaimResult(Contract):
    """One claim of the thesis: the statement, its value in the thesis and here, and the verdict."""

    key: str
    says: str
    thesis: float | str
    ours: float
    unit: str
    verdict: Verdict
    note: str


class ReproduceSummary(Contract):
    """A reproduced figure or table of the thesis: values of the thesis and here, with a verdict per claim."""

    item: str
    title: str
    verdict: Verdict = Field(description="verdict of the most important claim")
    thesis: dict[str, float | str]
    ours: dict[str, float]
    claims: list[ClaimResult]
    seeds: int
    note: str


class ReproduceTask(Contract):
    """Task of ``reproduce``."""

    input: ReproduceInput
