"""Progress reports of the solvers at every iteration, through CasADi's callbacks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from stridelab.centroidal.nlp.assembly import NonlinearProgram
from stridelab.centroidal.nlp.kkt import Box
from stridelab.centroidal.nlp.nlp import OBJECTIVE_SCALE


@dataclass(frozen=True)
class Iterate:
    """Iteration number, objective with regularisers and largest constraint violation (body weights and metres)."""

    number: int
    objective: float
    infeasibility: float


IterationCallback = Callable[[Iterate], None]
"""Called at every iteration of either solver."""


class IterateReporter:
    """Forwards iterates to the callback of the current run, if it has one."""

    def __init__(self, nlp: NonlinearProgram) -> None:
        self.nlp = nlp
        self.begin_run(None, None)

    def begin_run(self, on_iteration: IterationCallback | None, box: Box | None) -> None:
        """Begin a run with the bounds ``box``; resets the iteration count."""
        self._on_iteration, self._box, self._count = on_iteration, box, 0

    @property
    def has_callback(self) -> bool:
        """Whether the current run has a callback."""
        return self._on_iteration is not None

    def report_iterate(self, x: ca.DM, f: ca.DM, g: ca.DM) -> None:
        """Report the next iterate with its objective and constraint rows."""
        if self._on_iteration is not None and self._box is not None:
            self._on_iteration(Iterate(self._count, float(f) / OBJECTIVE_SCALE, _max_violation(self._box, x, g)))
        self._count += 1


def _max_violation(box: Box, x: ca.DM, g: ca.DM) -> float:
    w, rows = x.full().ravel(), g.full().ravel()
    excess = (box.lower - w, w - box.upper, box.row_lower - rows, rows - box.row_upper)
    return max(0.0, *(float(part.max(initial=0.0)) for part in excess))


class _IterationCallback(ca.Callback):
    """A function of dense columns of the given ``sizes`` that reports its arguments and returns one number."""

    def __init__(self, listener: IterateReporter, name: str, sizes: Sequence[int]) -> None:
        ca.Callback.__init__(self)
        self._listener, self._sizes = listener, sizes
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Number of arguments."""
        return len(self._sizes)

    def get_n_out(self) -> int:
        """One number."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """A dense column."""
        return ca.Sparsity.dense(self._sizes[i])


class IpoptCallback(_IterationCallback):
    """Iteration callback of ipopt, a function of the solver's results; never interrupts the solve."""

    def __init__(self, listener: IterateReporter) -> None:
        nlp = listener.nlp
        sizes = {"x": nlp.n, "lam_x": nlp.n, "g": nlp.n_rows, "lam_g": nlp.n_rows, "f": 1, "lam_p": nlp.n_p}
        names = [ca.nlpsol_out(i) for i in range(ca.nlpsol_n_out())]
        super().__init__(listener, "at_iterations", [sizes[name] for name in names])
        self._names = names

    def eval(self, arg: Sequence[ca.DM]) -> list[float]:
        """Report the iterate; the return value 0 lets ipopt continue."""
        results = dict(zip(self._names, arg, strict=True))
        self._listener.report_iterate(results["x"], results["f"], results["g"])
        return [0.0]


class HessianCallback(_IterationCallback):
    """Zero function of (x, p), added to the Hessian: fatrop has no callback but evaluates one Hessian per iteration."""

    def __init__(self, listener: IterateReporter) -> None:
        super().__init__(listener, "at_curvatures", (listener.nlp.n, listener.nlp.n_p))

    def eval(self, arg: Sequence[ca.DM]) -> list[float]:
        """Return zero; evaluates and reports the iterate if the run has a callback."""
        if self._listener.has_callback:
            nlp = self._listener.nlp
            self._listener.report_iterate(arg[0], nlp.value(*arg), nlp.rows(*arg))
        return [0.0]
