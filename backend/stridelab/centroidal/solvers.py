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
from stridelab.centroidal.sparse import constant
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
    if not np.isfinite(float(programme.objective.value(programme.guess))):  # fatrop would search its line for ever
        return Run(programme.guess, False, False, "the cost is not a number at the start", 0, 0.0, 0.0)
    try:
        solver = _SETUP[name](programme, limits)
        built = time.process_time()
        found = solver(x0=programme.guess, lbx=programme.lower, ubx=np.inf, lbg=programme.b, ubg=programme.b)
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
    """The programme in CasADi's symbols: variables, multipliers, objective, rows and their derivatives."""

    w: ca.MX
    p: ca.MX
    lam_f: ca.MX
    lam_g: ca.MX
    f: ca.MX
    g: ca.MX
    gradient: ca.MX
    A: ca.DM
    curvature: ca.MX

    @property
    def nlp(self) -> dict[str, ca.MX]:
        return {"x": self.w, "f": self.f, "g": self.g}

    def function(self, name: str, outputs: Mapping[str, ca.MX | ca.DM], multipliers: bool = False) -> ca.Function:
        """A derivative by the names that CasADi looks for."""
        inputs = {"x": self.w, "p": self.p} | ({"lam_f": self.lam_f, "lam_g": self.lam_g} if multipliers else {})
        return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def _expressions(programme: Transcription, theta: float) -> _Expressions:
    w, objective = ca.MX.sym("w", programme.layout.n), programme.objective
    A = constant(programme.A)
    return _Expressions(
        w=w,
        p=ca.MX.sym("p", 0),
        lam_f=ca.MX.sym("lam_f"),
        lam_g=ca.MX.sym("lam_g", A.size1()),
        f=objective.value(w),
        g=A @ w,
        gradient=objective.gradient(w),
        A=A,
        curvature=objective.curvature(w, theta),
    )


def _ipopt(programme: Transcription, limits: Limits) -> ca.Function:
    e = _expressions(programme, theta=1.0)
    options: dict[str, Any] = {
        "grad_f": e.function("nlp_grad_f", {"f": e.f, "grad_f_x": e.gradient}),
        "jac_g": e.function("nlp_jac_g", {"g": e.g, "jac_g_x": e.A}),
        "hess_lag": e.function("nlp_hess_l", {"triu_hess_gamma_x_x": e.lam_f * e.curvature}, multipliers=True),
        "no_nlp_grad": True,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.constr_viol_tol": 1e-8,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.mu_min": 1e-9,  # costs 0.003 of the objective and saves the last creep along the cones
        "ipopt.nlp_scaling_method": "none",
        "ipopt.jac_c_constant": "yes",
        "ipopt.bound_relax_factor": 0.0,  # the cones hold exactly
        "ipopt.max_iter": limits.iterations,
        "ipopt.max_wall_time": limits.wall_s,
    }
    return ca.nlpsol("centroidal", "ipopt", e.nlp, options)


def _fatrop(programme: Transcription, limits: Limits) -> ca.Function:
    """The stages are named, and the functions handed over as CasADi's cache: its fatrop has no options for them."""
    e = _expressions(programme, theta=0.0)
    slope = e.lam_f * e.gradient + e.A.T @ e.lam_g
    symmetric = ca.triu2symm(e.curvature)
    known = [
        e.function("nlp_grad_f", {"grad_f_x": e.gradient}),
        e.function("nlp_jac_g", {"g": e.g, "jac_g_x": e.A}),
        e.function(
            "nlp_grad", {"f": e.f, "g": e.g, "grad_gamma_x": slope, "grad_gamma_p": ca.MX(0, 1)}, multipliers=True
        ),
        e.function("nlp_hess_l", {"grad_gamma_x": slope, "hess_gamma_x_x": e.lam_f * symmetric}, multipliers=True),
    ]
    layout = programme.layout
    n_intervals = len(layout.wrench)
    options: dict[str, Any] = {
        "cache": {function.name(): function for function in known},
        "structure_detection": "manual",
        "N": n_intervals,
        "nx": [N_STATE] * (n_intervals + 1),
        "nu": [*(np.diff(layout.state) - N_STATE).tolist(), 0],
        "ng": list(programme.stage_rows),
        "equality": [True] * len(programme.b),
        "print_time": False,
        "calc_lam_p": False,
        "fatrop.print_level": 0,
        "fatrop.tol": TOLERANCE,
        "fatrop.max_iter": limits.iterations,
    }
    return ca.nlpsol("centroidal", "fatrop", e.nlp, options)


_SETUP: dict[SolverName, Callable[[Transcription, Limits], ca.Function]] = {"ipopt": _ipopt, "fatrop": _fatrop}
