"""The worst value of a quantity over a motion, with where and when it was met."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stridelab.conventions import Series
from stridelab.wholebody.certificate import Check


@dataclass(frozen=True, eq=False)
class Worst:
    """Turns series over the samples at ``time_s``, each in its ``phase``, into checks."""

    time_s: Series
    phase: Int[np.ndarray, "n"]

    def at_most(self, name: str, values: Float[np.ndarray, "n m"], unit: str, limit: float, of: Sequence[str]) -> Check:
        """The largest of ``values``, one column per name in ``of``; -inf where a quantity does not exist."""
        return self._check(name, values, unit, limit, of, at_least=False)

    def at_least(
        self, name: str, values: Float[np.ndarray, "n m"], unit: str, limit: float, of: Sequence[str]
    ) -> Check:
        """The smallest of ``values``; +inf where a quantity does not exist."""
        return self._check(name, values, unit, limit, of, at_least=True)

    def _check(
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
        # argmin and argmax find a NaN before any number, and a NaN passes no limit
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
