"""The certificate: all required properties of a motion, measured and compared with their limits."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Series


@dataclass(frozen=True)
class Check:
    """One measured property.

    ``value`` is the worst over the motion, at ``time_s`` in ``phase`` and of ``effector`` where applicable; the check
    passes at or below ``limit``, with ``at_least`` at or above it.
    """

    name: str
    value: float
    unit: str
    limit: float
    at_least: bool = False
    phase: int | None = None
    effector: str | None = None
    time_s: float | None = None

    @property
    def passed(self) -> bool:
        """Whether the value is within its limit; NaN is not."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


@dataclass(frozen=True)
class Certificate:
    """All checks of one motion."""

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True, eq=False)
class WorstValues:
    """Converts series over the samples at ``time_s``, each in its ``phase``, into checks of their worst values."""

    time_s: Series
    phase: Int[np.ndarray, "n"]

    def at_most(self, name: str, values: Float[np.ndarray, "n m"], unit: str, limit: float, of: Sequence[str]) -> Check:
        """Check of the largest of ``values``, one column per name in ``of``; -inf where a quantity does not exist."""
        return self._worst_check(name, values, unit, limit, of, at_least=False)

    def at_least(
        self, name: str, values: Float[np.ndarray, "n m"], unit: str, limit: float, of: Sequence[str]
    ) -> Check:
        """Check of the smallest of ``values``; +inf where a quantity does not exist."""
        return self._worst_check(name, values, unit, limit, of, at_least=True)

    def _worst_check(
        self,
        name: str,
        values: Float[np.ndarray, "n m"],
        unit: str,
        limit: float,
        of: Sequence[str],
        at_least: bool,
    ) -> Check:
        if values.size == 0 or not np.any(np.isfinite(values) | np.isnan(values)):
            return Check(name, limit, unit, limit, at_least)
        # argmin and argmax return a NaN before any number, and a NaN fails every limit
        i, j = divmod(int(np.argmin(values) if at_least else np.argmax(values)), values.shape[1])
        return Check(
            name=name,
            value=float(values[i, j]),
            unit=unit,
            limit=limit,
            at_least=at_least,
            phase=int(self.phase[i]),
            effector=of[j] or None,
            time_s=float(self.time_s[i]),
        )
