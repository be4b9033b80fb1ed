"""The certificate: every property that a motion must have to be worth trying, measured and compared with its limit."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One measured property.

    ``value`` is the worst over the motion, met in ``phase`` by ``effector`` where that says anything; it passes at or
    below ``limit``, or at or above it where ``at_least``.
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
        """Whether the value keeps its limit; NaN does not."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


@dataclass(frozen=True)
class Certificate:
    """All checks of one motion."""

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)
