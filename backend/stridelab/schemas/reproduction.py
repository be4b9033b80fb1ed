"""Input and result of ``reproduce``."""

from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

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
    "occupancy",
]
"""A figure of the thesis, the numbers in the text of a chapter, or a table on simulated walks or motions."""
Verdict = Literal["met", "beaten", "not_met", "thesis_in_error", "undecided"]
"""``met``: agrees with the thesis; ``beaten``: better than the thesis; ``not_met``: neither; ``undecided``: the claim
holds in a part of our interval only; of a claim with ``aim``,
``beaten``, ``not_met`` and ``undecided`` say whether an aim of this project is reached, and nothing on the thesis."""
Evidence = Literal["simulated", "replayed", "people", "external"]
Threshold = Literal["thesis", "words", "ours"]
NoInterval = Literal["deterministic", "in_claim", "one_case", "one_sample", "machine_time"]
Outcome = Literal[
    "not_met", "thesis_in_error", "undecided", "met", "beaten", "aim_missed", "aim_undecided", "aim_reached"
]
ITEMS_WITH_DRAWS: Final = frozenset(
    [
        "fig-2.6",
        "fig-2.7",
        "fig-2.8",
        "fig-2.9",
        "fig-3.6",
        "fig-3.7",
        "fig-3.8",
        "fig-3.9",
        "numbers-2",
        "errors",
        "lag",
        "coverage",
        "partial-force",
        "flight",
    ]
)
"""Items whose number of random draws can be chosen."""
ITEMS_WITH_SAMPLE: Final = frozenset(
    [
        "fig-3.3",
        "fig-3.4",
        "fig-3.5",
        "fig-3.10",
        "fig-4.2",
        "fig-4.3",
        "fig-4.4",
        "fig-4.5",
        "fig-4.6",
        "numbers-3",
        "numbers-4",
        "occupancy",
    ]
)
"""Items that draw one random sample of fixed size."""
LEAST_DRAWS: Final = {"fig-3.6": 2, "fig-3.7": 2, "fig-3.8": 2, "fig-3.9": 2}
"""Smallest number of draws of items that need several people."""


NO_DRAWS: Final = "draws nothing at random: leave seeds and seed out"


class ReproduceInput(Contract):
    """Input of ``reproduce``."""

    item: ReproductionItem
    seeds: Annotated[int, Field(ge=1, le=200)] | None = Field(
        default=None,
        description="number of random draws (simulated walks or people); null takes as many as fit into a minute, 50 "
        "is accurate. Refused by items that draw nothing or one sample of fixed size",
    )
    seed: Annotated[int, Field(ge=0, le=1_000_000)] | None = Field(
        default=None, description="first seed of the draws; null is 0. Refused by items that draw nothing"
    )

    @model_validator(mode="after")
    def _draws_exist(self) -> "ReproduceInput":
        if self.seeds is not None and self.item not in ITEMS_WITH_DRAWS:
            drawn = "draws one sample of fixed size: give seed alone" if self.item in ITEMS_WITH_SAMPLE else NO_DRAWS
            raise ValueError(f"seeds: {self.item} {drawn}")
        least = LEAST_DRAWS.get(self.item, 1)
        if self.seeds is not None and self.seeds < least:
            raise ValueError(f"seeds: {self.item} needs {least} draws at least, not {self.seeds}")
        if self.seed is not None and self.item not in ITEMS_WITH_DRAWS | ITEMS_WITH_SAMPLE:
            raise ValueError(f"seed: {self.item} {NO_DRAWS}")
        return self


def _outcome_of_aim(verdict: Verdict) -> Outcome:
    if verdict == "undecided":
        return "aim_undecided"
    return "aim_reached" if verdict in ("met", "beaten") else "aim_missed"


class ClaimResult(Contract):
    """One claim of the thesis: the statement, its value in the thesis and here, and the verdict."""

    key: str
    says: str
    thesis: float | str
    ours: float
    unit: str
    verdict: Verdict
    note: str
    evidence: Evidence = Field(
        description="origin of ours: models and simulated recordings, motions replayed in physics, recordings of "
        "people, or numbers published by others"
    )
    n: int = Field(ge=1, description="number of cases (draws, steps, people, contact sets, plans) behind ours")
    solver: str | None = None
    interval: tuple[float, float] | None = Field(default=None, description="95 % interval of ours")
    comparator: str | None = Field(default=None, description="what ours is compared with")
    aim: bool = Field(default=False, description="a threshold of this project: no verdict on the thesis")
    where: str = Field(default="", description="section, figure or table of the thesis that makes the claim")
    holds: str = Field(default="", description="range of ours in which the claim holds, and whose bounds these are")
    holds_from: float | None = None
    holds_to: float | None = None
    strict: bool = Field(default=False, description="whether the claim does not hold at the bounds themselves")
    threshold: Threshold = Field(
        default="ours",
        description="whose the bounds are: printed in the thesis, implied by its words without a number, or ours",
    )
    overturned_by: str = Field(default="", description="what would overturn the verdict")
    cases_inside: int | None = Field(
        default=None,
        description="of a claim on every case, whose number is the most extreme one: how many of the n cases are in "
        "the range themselves",
    )
    no_interval: NoInterval | None = Field(
        default=None,
        description="why there is neither interval nor cases_inside: nothing is drawn, the claim is on sampling error, "
        "one case, one sample of fixed size, or a time of one machine",
    )
    uncertainty: str = Field(
        default="",
        description="interval of ours, or of the share of all cases in the range, or why there is none, as text",
    )

    @property
    def outcome(self) -> Outcome:
        """The verdict on the thesis, or whether our own aim is reached."""
        return _outcome_of_aim(self.verdict) if self.aim else self.verdict


class ReproduceSummary(Contract):
    """A reproduced figure or table of the thesis: values of the thesis and here, with a verdict per claim."""

    item: str
    title: str
    verdict: Verdict = Field(description="the most important verdict on the thesis; of our aims if there is none")
    thesis: dict[str, float | str]
    ours: dict[str, float]
    claims: list[ClaimResult]
    seeds: int
    seed: int = 0
    sampling: str = Field(default="", description="what the item draws at random, and how often")
    command: str = Field(default="", description="command line that computes the item again with the same draws")
    note: str

    @property
    def outcome(self) -> Outcome:
        """The verdict; of an item with nothing but aims of this project, whether all are reached."""
        return _outcome_of_aim(self.verdict) if all(claim.aim for claim in self.claims) else self.verdict

    @model_validator(mode="before")
    @classmethod
    def _with_basis(cls, data: Any) -> Any:
        """Results of older versions state no basis: all were simulated, with one case per draw."""
        if isinstance(data, dict):
            for claim in data.get("claims", ()):
                if isinstance(claim, dict) and "evidence" not in claim:
                    claim |= {"evidence": "simulated", "n": max(1, data.get("seeds", 1))}
                    claim["aim"] = str(claim.get("thesis", "")).startswith("aim ")
        return data


class ReproduceTask(Contract):
    """Task of ``reproduce``."""

    input: ReproduceInput
