"""Progress reports of the solvers at every iteration, through CasADi's callbacks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from stridelab.centroidal.nlp.assembly import Programme
from stridelab.centroidal.nlp.kkt import Box
from stridelab.centroidal.nlp.nlp import SCALE


@dataclass(frozen=True)
class Iterate:
    """Iteration number, objective with regularisers and largest constraint violation (body weights and metres)."""

    number: int
    objective: float
    infeasibility: float


Tell = Callable[[Iterate], None]
"""Called at every iteration of either solver."""


class Listener:
    """Forwards iterates to the callback of the current run, if it has one."""

    def __init__(self, programme: Programme) -> None:
        self.programme = programme
        self.listen(None, None)

    def listen(self, tell: Tell | None, box: Box | None) -> None:
        """Begin a run with the bounds ``box``; resets the iteration count."""
        self._tell, self._box, self._count = tell, box, 0

    @property
    def listening(self) -> bool:
        """Whether the current run has a callback."""
        return self._tell is not None

    def hear(self, x: ca.DM, f: ca.DM, g: ca.DM) -> None:
        """Report the next iterate with its objective and constraint rows."""
        if self._tell is not None and self._box is not None:
            self._tell(Iterate(self._count, float(f) / SCALE, _violation(self._box, x, g)))
        self._count += 1


def _violation(box: Box, x: ca.DM, g: ca.DM) -> float:
    w, rows = x.full().ravel(), g.full().ravel()
    excess = (box.lower - w, w - box.upper, box.row_lower - rows, rows - box.row_upper)
    return max(0.0, *(float(part.max(initial=0.0)) for part in excess))


class AtIterations(ca.Callback):
    """Iteration callback of ipopt; never interrupts the solve."""

    def __init__(self, listener: Listener) -> None:
        ca.Callback.__init__(self)
        self._listener, nlp = listener, listener.programme
        self._sizes = {"x": nlp.n, "lam_x": nlp.n, "g": nlp.n_rows, "lam_g": nlp.n_rows, "f": 1, "lam_p": nlp.n_p}
        self.construct("at_iterations", {})

    def get_n_in(self) -> int:
        """Number of results of a solver."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """One number."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """A dense column, of the size of the solver's i-th result."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)])

    def eval(self, arg: Sequence[ca.DM]) -> list[float]:
        """Report the iterate; the return value 0 lets ipopt continue."""
        results = dict(zip(map(ca.nlpsol_out, range(len(arg))), arg, strict=True))
        self._listener.hear(results["x"], results["f"], results["g"])
        return [0.0]


class AtCurvatures(ca.Callback):
    """Zero function of (x, p), added to the Hessian: fatrop has no callback but evaluates one Hessian per iteration."""

    def __init__(self, listener: Listener) -> None:
        ca.Callback.__init__(self)
        self._listener = listener
        self._sizes = (listener.programme.n, listener.programme.n_p)
        self.construct("at_curvatures", {})

    def get_n_in(self) -> int:
        """The variables x and the parameters p."""
        return 2

    def get_n_out(self) -> int:
        """One number."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """A dense column, x for 0 and p for 1."""
        return ca.Sparsity.dense(self._sizes[i])

    def eval(self, arg: Sequence[ca.DM]) -> list[float]:
        """Return zero; evaluates and reports the iterate if the run has a callback."""
        if self._listener.listening:
            nlp = self._listener.programme
            self._listener.hear(arg[0], nlp.value(*arg), nlp.rows(*arg))
        return [0.0]
