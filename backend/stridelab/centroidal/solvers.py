"""The programme handed to ipopt or fatrop through CasADi, quietly and within limits; nothing here raises.

Both get the same functions and the constant rows, so that CasADi differentiates nothing. ipopt (adaptive barrier,
MUMPS) corrects an indefinite curvature itself and gets the true one of the log-densities: about 20 iterations on
stairs. fatrop, which goes through the stages, gets the majoriser; it needs three to ten times as many iterations, and
its set-up grows faster than the number of stages (figures in docs/theory/centroidal-problem.md).
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from stridelab.centroidal.dynamics import N_STATE
from stridelab.centroidal.layout import n_cones
from stridelab.centroidal.parts import Programme
from stridelab.centroidal.programme import Compiled
from stridelab.centroidal.transcription import Transcription
from stridelab.conventions import Series

SolverName = Literal["ipopt", "fatrop"]
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Limits:
    """When to give up: iterations, and seconds of wall time (ipopt alone; fatrop counts iterations only)."""

    iterations: int = 300
    wall_s: float = 60.0


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, eq=False)
class Run:
    """Where a solver stopped: the variables, whether it calls that a solution, its own words, its effort.

    ``infeasible``: it says that the constraints, which are all linear, have no solution.
    """

    w: Series
    success: bool
    infeasible: bool
    status: str
    iterations: int
    build_s: float
    solve_s: float


def run(name: SolverName, programme: Transcription, limits: Limits) -> Run:
    """Solve from the programme's guess; a failure of any kind is a ``Run`` without success. Times are CPU times."""
    started = time.process_time()
    built = started
    if not np.isfinite(
        float(programme.compiled.programme.value(programme.guess, programme.p))
    ):  # fatrop would search its line for ever
        return Run(programme.guess, False, False, "the cost is not a number at the start", 0, 0.0, 0.0)
    try:
        solver = _SETUP[name](programme.compiled, limits)
        built = time.process_time()
        found = solver(
            x0=programme.guess,
            p=programme.p,
            lbx=programme.lower,
            ubx=programme.upper,
            lbg=programme.row_lower,
            ubg=programme.row_upper,
        )
    except RuntimeError as failure:  # all that CasADi raises
        words = str(failure).strip().splitlines()[-1]
        return Run(programme.guess, False, False, words, 0, built - started, time.process_time() - built)
    solve_s = time.process_time() - built
    stats, w = solver.stats(), found["x"].full().ravel()
    finite = bool(np.isfinite(w).all())
    said = str(stats["return_status"] if name == "ipopt" else stats["unified_return_status"])
    return Run(
        w=w if finite else programme.guess,
        success=bool(stats["success"]) and finite,
        infeasible=said == "Infeasible_Problem_Detected",
        status=said.replace("_", " ").lower(),
        iterations=int(stats["iter_count"]),
        build_s=built - started,
        solve_s=solve_s,
    )


@dataclass(frozen=True, eq=False)
class _Expressions:
    """A compiled programme under the names that CasADi looks for."""

    programme: Programme
    x: ca.MX
    p: ca.MX
    lam_f: ca.MX
    lam_g: ca.MX

    @staticmethod
    def of(programme: Programme) -> "_Expressions":
        x, p = ca.MX.sym("x", programme.n), ca.MX.sym("p", programme.n_p)
        return _Expressions(programme, x, p, ca.MX.sym("lam_f"), ca.MX.sym("lam_g", programme.n_rows))

    @property
    def nlp(self) -> dict[str, ca.MX]:
        return {"x": self.x, "p": self.p, "f": self.f, "g": self.g}

    @property
    def f(self) -> ca.MX:
        return self.programme.value(self.x, self.p)

    @property
    def g(self) -> ca.MX:
        return self.programme.rows(self.x, self.p)

    @property
    def gradient(self) -> ca.MX:
        return self.programme.gradient(self.x, self.p)

    @property
    def jacobian(self) -> ca.MX:
        return self.programme.jacobian(self.x, self.p)

    def hessian(self, theta: float) -> ca.MX:
        return self.programme.hessian(self.x, self.p, self.lam_f, self.lam_g, theta)

    def function(self, name: str, outputs: Mapping[str, ca.MX | ca.DM], multipliers: bool = False) -> ca.Function:
        """A derivative by the names that CasADi looks for."""
        inputs = {"x": self.x, "p": self.p} | ({"lam_f": self.lam_f, "lam_g": self.lam_g} if multipliers else {})
        return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def _ipopt(of: Compiled, limits: Limits) -> ca.Function:
    e = _Expressions.of(of.programme)
    options: dict[str, Any] = {
        "grad_f": e.function("nlp_grad_f", {"f": e.f, "grad_f_x": e.gradient}),
        "jac_g": e.function("nlp_jac_g", {"g": e.g, "jac_g_x": e.jacobian}),
        "hess_lag": e.function("nlp_hess_l", {"triu_hess_gamma_x_x": e.hessian(theta=1.0)}, multipliers=True),
        "no_nlp_grad": True,
        "calc_lam_p": False,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.constr_viol_tol": 1e-8,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.mu_min": 1e-9,  # costs 0.003 of the objective and saves the last creep along the cones
        "ipopt.nlp_scaling_method": "none",
        "ipopt.bound_relax_factor": 0.0,  # the cones hold exactly
        "ipopt.max_iter": limits.iterations,
        "ipopt.max_wall_time": limits.wall_s,
    }
    return ca.nlpsol("centroidal", "ipopt", e.nlp, options)


def _fatrop(of: Compiled, limits: Limits) -> ca.Function:
    """The stages are named, and the functions handed over as CasADi's cache: its fatrop has no options for them."""
    e, layout = _Expressions.of(of.programme), of.layout
    slope = e.lam_f * e.gradient + e.jacobian.T @ e.lam_g
    known = [
        e.function("nlp_grad_f", {"grad_f_x": e.gradient}),
        e.function("nlp_jac_g", {"g": e.g, "jac_g_x": e.jacobian}),
        e.function(
            "nlp_grad",
            {"f": e.f, "g": e.g, "grad_gamma_x": slope, "grad_gamma_p": ca.MX(of.programme.n_p, 1)},
            multipliers=True,
        ),
        e.function(
            "nlp_hess_l",
            {"grad_gamma_x": slope, "hess_gamma_x_x": ca.triu2symm(e.hessian(theta=0.0))},
            multipliers=True,
        ),
    ]
    n_intervals = len(layout.wrench)
    equality = np.ones(layout.n_rows, dtype=bool)
    for use in layout.uses:
        equality[use.row : use.row + n_cones(use.group)] = False
    options: dict[str, Any] = {
        "cache": {function.name(): function for function in known},
        "structure_detection": "manual",
        "N": n_intervals,
        "nx": [N_STATE] * (n_intervals + 1),
        "nu": [*(np.diff(layout.state) - N_STATE).tolist(), 0],
        "ng": list(layout.stage_rows),
        "equality": equality.tolist(),
        "print_time": False,
        "calc_lam_p": False,
        "fatrop.print_level": 0,
        "fatrop.tol": TOLERANCE,
        "fatrop.max_iter": limits.iterations,
    }
    return ca.nlpsol("centroidal", "fatrop", e.nlp, options)


_SETUP: dict[SolverName, Callable[[Compiled, Limits], ca.Function]] = {"ipopt": _ipopt, "fatrop": _fatrop}
