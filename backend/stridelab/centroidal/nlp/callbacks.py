"""What a solver tells while it runs: where it is at every iteration, through CasADi's callbacks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from stridelab.centroidal.nlp.assembly import Programme
from stridelab.centroidal.nlp.kkt import Box
from stridelab.centroidal.nlp.nlp import SCALE


@dataclass(frozen=True)
class Iterate:
    """Iterations so far, and at this one the objective with its regularisers and the worst violation of a constraint.

    The violation is in the programme's units: body weights and metres.
    """

    number: int
    objective: float
    infeasibility: float


Tell = Callable[[Iterate], None]
"""Called at every iteration of either solver."""


class Listener:
    """Tells of iterates for as long as somebody listens."""

    def __init__(self, programme: Programme) -> None:
        self.programme = programme
        self.listen(None, None)

    def listen(self, tell: Tell | None, box: Box | None) -> None:
        """Another run begins, within ``box``."""
        self._tell, self._box, self._count = tell, box, 0

    @property
    def listening(self) -> bool:
        """Whether what is heard goes anywhere."""
        return self._tell is not None

    def hear(self, x: ca.DM, f: ca.DM, g: ca.DM) -> None:
        """The next iterate, with its objective and rows."""
        if self._tell is not None and self._box is not None:
            self._tell(Iterate(self._count, float(f) / SCALE, _violation(self._box, x, g)))
        self._count += 1


def _violation(box: Box, x: ca.DM, g: ca.DM) -> float:
    w, rows = x.full().ravel(), g.full().ravel()
    lacks = (box.lower - w, w - box.upper, box.row_lower - rows, rows - box.row_upper)
    return max(0.0, *(float(lack.max(initial=0.0)) for lack in lacks))


class AtIterations(ca.Callback):
    """What ipopt calls after every iteration; it goes on for ever."""

    def __init__(self, listener: Listener) -> None:
        ca.Callback.__init__(self)
        self._listener, of = listener, listener.programme
        self._sizes = {"x": of.n, "lam_x": of.n, "g": of.n_rows, "lam_g": of.n_rows, "f": 1, "lam_p": of.n_p}
        self.construct("at_iterations", {})

    def get_n_in(self) -> int:
        """As many as a solver has results."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """One number."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """A dense column, of the size of the solver's i-th result."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)])

    def eval(self, arg: Sequence[ca.DM]) -> list[float]:
        """Hand the iterate on; 0 tells ipopt to go on."""
        of = dict(zip(map(ca.nlpsol_out, range(len(arg))), arg, strict=True))
        self._listener.hear(of["x"], of["f"], of["g"])
        return [0.0]


class AtCurvatures(ca.Callback):
    """Nought, as a function of (x, p), for a Hessian to add: fatrop has no callback and asks for one per iteration."""

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
        """Nought; where somebody listens, the iterate is evaluated and handed on."""
        if self._listener.listening:
            of = self._listener.programme
            self._listener.hear(arg[0], of.value(*arg), of.rows(*arg))
        return [0.0]
