"""Errors of the clients."""

from stridelab.schemas.base import FaultItem, Problem


class ClientError(Exception):
    """Base of the client's errors."""


class Unreachable(ClientError):
    """The service did not answer."""


class ProblemError(ClientError):
    """The service answered with a problem."""

    def __init__(self, problem: Problem, retry_after_s: float | None = None) -> None:
        super().__init__(problem.detail)
        self.problem = problem
        self.retry_after_s = retry_after_s

    @property
    def status(self) -> int:
        """HTTP status."""
        return self.problem.status

    @property
    def code(self) -> str:
        """Stable code of the failure."""
        return self.problem.code

    @property
    def detail(self) -> str:
        """Explanation of the failure."""
        return self.problem.detail

    @property
    def errors(self) -> list[FaultItem]:
        """Places in the input that caused the failure."""
        return self.problem.errors
