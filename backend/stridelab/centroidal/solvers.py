"""The programme handed to ipopt or fatrop through CasADi, quietly and within limits; nothing here raises.

ipopt (adaptive barrier, Mehrotra's step lengths off, MUMPS) is the reference; fatrop exploits the stages. Both get the
same functions, and constant rows.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from stridelab.centroidal.sparse import constant
from stridelab.centroidal.transcription import Transcription
from stridelab.conventions import Series

SolverName = Literal["ipopt", "fatrop"]
TOLERANCE = 1e-6


@dataclass(frozen=True)
class Limits:
    """When to give up: iterations, and seconds of wall time (ipopt only; fatrop knows iterations)."""

    iterations: int = 200
    wall_s: float = 60.0


DEFAULT_LIMITS = Limits()


@dataclass(frozen=True, eq=False)
class Run:
    """Where a solver stopped: the variables, whether it calls that a solution, its own words, its effort."""

    w: Series
    success: bool
    status: str
    iterations: int
    cpu_s: float


def run(name: SolverName, programme: Transcription, limits: Limits) -> Run:
    """Solve from the programme's guess; a failure of any kind is a ``Run`` without success."""
    solver = _SETUP[name](programme, limits)
    started = time.process_time()
    try:
        found = solver(x0=programme.guess, lbx=programme.lower, ubx=np.inf, lbg=programme.b, ubg=programme.b)
    except RuntimeError as failure:  # CasADi's only exception
        return Run(programme.guess, False, str(failure).splitlines()[-1], 0, time.process_time() - started)
    cpu_s = time.process_time() - started
    stats, w = solver.stats(), found["x"].full().ravel()
    success = bool(stats["success"]) and bool(np.isfinite(w).all())
    status = str(stats["return_status"]).replace("_", " ").lower()
    return Run(w if np.isfinite(w).all() else programme.guess, success, status, int(stats["iter_count"]), cpu_s)


def _programme(programme: Transcription) -> tuple[dict[str, ca.MX], dict[str, ca.Function]]:
    """The programme's expressions, and its derivatives by CasADi's names for them."""
    w, p = ca.MX.sym("w", programme.layout.n), ca.MX.sym("p", 0)
    A = constant(programme.A)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", A.size1())
    f, g = programme.objective.value(w), A @ w
    upper = lam_f * programme.objective.curvature(w)
    functions = {
        "gradient": ca.Function(
            "nlp_grad_f", [w, p], [f, programme.objective.gradient(w)], ["x", "p"], ["f", "grad_f_x"]
        ),
        "jacobian": ca.Function("nlp_jac_g", [w, p], [g, A], ["x", "p"], ["g", "jac_g_x"]),
        "hessian": ca.Function(
            "nlp_hess_l", [w, p, lam_f, lam_g], [upper], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        ),
    }
    return {"x": w, "f": f, "g": g}, functions


def _ipopt(programme: Transcription, limits: Limits) -> ca.Function:
    nlp, derivative = _programme(programme)
    options: dict[str, Any] = {
        "grad_f": derivative["gradient"],
        "jac_g": derivative["jacobian"],
        "hess_lag": derivative["hessian"],
        "no_nlp_grad": True,
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": TOLERANCE,
        "ipopt.constr_viol_tol": 1e-8,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.nlp_scaling_method": "none",
        "ipopt.jac_c_constant": "yes",
        "ipopt.bound_relax_factor": 0.0,  # the cones hold exactly
        "ipopt.max_iter": limits.iterations,
        "ipopt.max_wall_time": limits.wall_s,
    }
    return ca.nlpsol("centroidal", "ipopt", nlp, options)


_SETUP: dict[SolverName, Callable[[Transcription, Limits], ca.Function]] = {"ipopt": _ipopt}
