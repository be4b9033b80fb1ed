"""Draws of an item: several per seed, and some that allow no estimate, which are counted and do not end the item."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from stridelab.conventions import Progress
from stridelab.errors import NotEstimable

MIN_ACCEPTED_SHARE: Final = 0.5
"""Where fewer of the draws allow an estimate, the accepted ones are no sample of what is drawn."""
Result = TypeVar("Result")


@dataclass(frozen=True)
class AcceptedDraws(Generic[Result]):
    """Results of the draws that allow an estimate, by seed, and the messages of the others."""

    results: dict[int, Result]
    refused: dict[int, str]

    def describe_refused(self) -> str:
        """How many were refused and why, as a sentence that follows another one; empty where none was."""
        if not self.refused:
            return ""
        drawn = len(self.results) + len(self.refused)
        seeds = ", ".join(map(str, self.refused))
        return f" {len(self.results)} of {drawn} draws accepted, refused: seed {seeds} ({_reasons_text(self.refused)})."


def own_seeds(seeds: range, per_seed: int) -> range:
    """Seeds of ``per_seed`` draws for each seed, which no other seed has."""
    return range(per_seed * seeds[0], per_seed * (seeds[-1] + 1))


def accept_draws(seeds: Iterable[int], compute: Callable[[int], Result], tell: Progress) -> AcceptedDraws[Result]:
    """Compute every draw; those that raise ``NotEstimable`` are refused.

    Raises ``NotEstimable`` (``too-few-draws``) if less than ``MIN_ACCEPTED_SHARE`` of the draws are accepted.
    """
    results: dict[int, Result] = {}
    refused: dict[int, str] = {}
    wanted = list(seeds)
    for k, seed in enumerate(wanted):
        tell(k / len(wanted), f"draw {k + 1} of {len(wanted)}")
        try:
            results[seed] = compute(seed)
        except NotEstimable as error:
            refused[seed] = error.message
    if len(results) < max(1.0, MIN_ACCEPTED_SHARE * len(wanted)):
        message = f"Only {len(results)} of {len(wanted)} draws allow an estimate: {_reasons_text(refused)}."
        raise NotEstimable("too-few-draws", message)
    return AcceptedDraws(results, refused)


def _reasons_text(refused: dict[int, str]) -> str:
    """Every reason once, with the number of draws where several were refused."""
    counts = Counter(message.rstrip(".") for message in refused.values())
    return "; ".join(reason if len(refused) == 1 else f"{reason}: {n}" for reason, n in counts.items())
