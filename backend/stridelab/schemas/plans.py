"""Inputs and summaries of the robot wing's jobs."""

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.scenarios import Friction, OneLine, Scenario, ScenarioContact, TerrainSurface

PLAN_STAGES: Final = ("check", "reachability", "centroidal", "whole body", "certificate", "export", "replay")
"""Stages of ``plan-motion`` in their order: keys of ``stage_times_s``, first words of its progress messages."""

Formulation = Literal["forces", "circular-cones", "wrench"]
Shape = Literal["constant", "cubic"]
Film = Literal["gif", "mp4"]
NODE_RATE_HZ: Final = (2.0, 50.0)
"""Fewest and most nodes per second that can be asked for."""
TIME_LIMIT_S: Final = 300.0
"""Longest time that a solver can be given; the job itself ends after ten minutes."""

DURATION_RANGE: Final = (0.7, 1.4)
"""Between how many times its own length a phase may last where durations are free.

At 0.6 to 1.6 the body that follows on the long strides swings its legs too fast for the angular momentum of the plan.
"""
LEAST_SHARE, MOST_SHARE = 0.1, 10.0
"""The widest range that can be asked for."""


class PlanMotionInput(Contract):
    """Input of ``plan-motion``: a stored scenario or a whole one, never both.

    ``formulation`` is the control: ``forces`` of the contact points, the same in ``circular-cones`` with every solver,
    or the ``wrench`` of all contacts in one cone. ``solver``: ``auto`` asks ``native``, the C++ solver, where it is
    there and can do what is asked, else ``casadi``: ipopt, and fatrop where that fails. ``native`` takes the cones of
    ``forces`` as they are, CasADi's solvers pyramids within them; the summary says which. ``node_rate_hz`` are the
    nodes per second of every phase; forces between them are ``constant``, or with ``shape`` ``cubic`` one spline each,
    without a jump. Null takes splines where a body is to follow forces and there are any, else constants.
    ``time_limit_s`` (processor time) ends a solver in place of a minute; fatrop, which cannot be interrupted, gets as
    many iterations as are taken to fit, and is then not asked by ``auto``. With ``free_durations`` the solver chooses
    how long each phase lasts, between the two multiples of ``duration_range`` of what the scenario says; the whole
    motion keeps its length. In ``circular-cones`` only ``native`` can. ``measure`` chooses among the bundled
    reachability densities; null takes the default one. A ``film`` of the motion needs ffmpeg where the job runs.
    """

    scenario_id: str | None = None
    scenario: Scenario | None = None
    formulation: Formulation = "forces"
    solver: Literal["auto", "native", "casadi", "ipopt", "fatrop"] = "auto"
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0
    shape: Shape | None = None
    time_limit_s: Annotated[float, Field(gt=0.0, le=TIME_LIMIT_S)] | None = None
    free_durations: bool = False
    duration_range: tuple[
        Annotated[float, Field(ge=LEAST_SHARE, le=1.0)], Annotated[float, Field(ge=1.0, le=MOST_SHARE)]
    ] = DURATION_RANGE
    measure: Literal["uniform", "conditioned"] | None = None
    whole_body: bool = True
    replay: bool = False
    film: Film | None = None

    @model_validator(mode="after")
    def _one_scenario(self) -> "PlanMotionInput":
        if (self.scenario_id is None) == (self.scenario is None):
            raise ValueError("give either scenario_id or scenario")
        if self.replay and not self.whole_body:
            raise ValueError("a replay needs whole_body")
        if self.film is not None and not self.whole_body:
            raise ValueError("film: it needs whole_body")
        if self.free_durations and self.solver == "fatrop":
            raise ValueError("free_durations: they belong to many stages, and fatrop solves one by one; ask ipopt")
        if self.shape == "cubic" and (self.formulation == "wrench" or self.solver == "fatrop"):
            raise ValueError("shape: cubic is for forces, and not for fatrop, which solves interval by interval")
        if self.free_durations and self.formulation == "circular-cones" and self.solver not in ("auto", "native"):
            raise ValueError("free_durations: CasADi does not converge with circular-cones; ask for forces or wrench")
        return self


class CertificateCheck(Contract):
    """One property of the motion: ``value`` against ``limit``, at most or at least."""

    name: str
    value: float
    unit: str
    limit: float
    at_least: bool
    passed: bool
    phase: int | None = None
    effector: str | None = None
    time_s: float | None = None


class CertificateSummary(Contract):
    """All checks of a motion."""

    passed: bool
    checks: list[CertificateCheck]


class ReplayCollision(Contract):
    """Two links, or a link or an effector and a surface, that touch without being planned to.

    ``time_s`` is when they first do, ``force_max_n`` the largest force between them.
    """

    first: str
    second: str
    time_s: float
    force_max_n: float


class ReplaySummary(Contract):
    """What happened when the motion was replayed in physics.

    ``completed``: the robot does not fall, nothing touches that is not planned to, no loaded sole slips by more than
    20 mm, no torque asked for exceeds 1.2 of its limit, and every planned hand is loaded in its place for 95 % of its
    contact. ``remarks`` say what is missing. Only a robot that falls has a ``fall_time_s``. ``slip_max_m`` is
    ``foot_slip_max_m``; ``collisions`` counts the pairs of ``collided``. Plans of earlier versions lack the last five
    fields, and their ``completed`` says only that the robot did not fall.
    """

    completed: bool
    fall_time_s: float | None = None
    com_error_rms_m: float
    com_error_max_m: float
    foot_slip_max_m: float
    landing_error_max_m: float
    hand_force_mean_n: float | None = None
    hand_contact_share: float | None = None
    torque_ratio_max: float
    real_time_factor: float
    slip_max_m: float | None = None
    hand_in_place_shares: dict[str, float] | None = None
    collisions: int | None = None
    collided: list[ReplayCollision] | None = None
    remarks: list[Remark] | None = None


class StoppedMotion(Contract):
    """Where the whole body could not follow the plan any more.

    ``level`` is the first level of the hierarchy that was violated, counted from 0; ``names`` say what ran out, of
    which joints or effectors, the worst first. There is a motion until ``time_s``.
    """

    time_s: float
    phase: int
    level: int
    level_name: str
    names: list[str]


class CostWeights(Contract):
    """Weights of the terms of the cost, each of which then counts seconds.

    ``com_acceleration`` is in s⁴/m² and ``momentum_rate`` in 1/(N m)²; ``likelihood`` weighs minus the natural
    logarithm of densities in 1/m³. ``surface_force`` and ``point_force`` weigh the squares of the forces of soles and
    of hands, in body weights: they are no part of the objective.
    """

    com_acceleration: float
    momentum_rate: float
    likelihood: float
    surface_force: float
    point_force: float


class PlanVerification(Contract):
    """The centroidal solution checked by plain arithmetic."""

    dynamics_gap: float
    terminal_gap: float
    cone_margin_n: float
    normal_force_min_n: float


class PhaseDuration(Contract):
    """How long a phase lasts: as the scenario says, and as the solver chose."""

    given_s: float
    chosen_s: float


class AgreementPass(Contract):
    """How far plan and body were apart in angular momentum, the largest and the RMS, and what that plan took (CPU)."""

    mismatch_max_nms: float
    mismatch_rms_nms: float
    solve_time_s: float


class PlanMotionSummary(Contract):
    """Summary of ``plan-motion``.

    ``objective`` is the sum of ``cost_terms`` without ``surface_force`` and ``point_force``. These two are part of what
    the solver minimises with the contact forces as control; with the wrench they say what the forces cost that were
    found for it afterwards. ``formulation``, ``shape``, ``measure``, ``node_rate_hz``, ``weights`` and
    ``kkt_error`` (the largest violation of the first-order conditions, in units of the solver) are null where the
    version of the result did not tell them. ``phase_durations`` is null where the scenario's durations were kept.
    ``normal_force_max_n`` bounds the hands by what their arms can carry; empty with the wrench as control.
    ``solver_because`` is why the C++ solver did not serve, null where it did. ``stopped`` is there only in a job that
    failed because the body cannot follow the plan. ``agreement`` has one entry per pass of plan and whole body, more
    than one where strides are longer than 0.9 m or swings shorter than 0.8 s.
    """

    scenario_name: str
    robot: str
    duration_s: float
    n_phases: int
    converged: bool
    solver: str
    solver_because: str | None = None
    objective: float
    cost_terms: dict[str, float]
    weights: CostWeights | None = None
    formulation: Formulation | None = None
    measure: Literal["uniform", "conditioned"] | None = None
    shape: Shape | None = None
    node_rate_hz: float | None = None
    kkt_error: float | None = None
    phase_durations: list[PhaseDuration] | None = None
    normal_force_max_n: dict[str, float] = Field(default_factory=dict)
    iterations: int
    solve_time_s: float
    build_time_s: float
    verification: PlanVerification
    stage_times_s: dict[str, float]
    certificate: CertificateSummary | None = None
    replay: ReplaySummary | None = None
    stopped: StoppedMotion | None = None
    agreement: list[AgreementPass] = Field(default_factory=list)
    warnings: list[Remark]


class StanceInput(Contract):
    """Contacts of all effectors that touch, as in a phase."""

    contacts: Annotated[list[ScenarioContact], Field(min_length=1, max_length=16)]


class PlanContactsInput(Contract):
    """Input of ``plan-contacts``: from ``start`` to ``goal``, each with both feet.

    A hand that either of them names may use the rails.
    """

    robot: Annotated[str, Field(min_length=1, max_length=60)]
    terrain: Annotated[list[TerrainSurface], Field(min_length=1, max_length=200)]
    start: StanceInput
    goal: StanceInput
    friction: Friction = 0.3
    name: OneLine | None = None


class PlanContactsSummary(Contract):
    """Summary of ``plan-contacts``: a scenario that passes ``POST /scenarios/check``.

    ``objective_m`` is how far, in all, the placements are from even steps; ``programs`` how many mixed-integer
    programs were solved, one per number of steps and leading foot.
    """

    scenario: Scenario
    steps: int
    duration_s: float
    objective_m: float
    programs: int
    solve_time_s: float
    warnings: list[Remark]


class LearnReachabilityInput(Contract):
    """Input of ``learn-reachability``; ``effectors`` null learns all of the robot's."""

    robot: str
    effectors: Annotated[list[str], Field(min_length=1, max_length=16)] | None = None
    samples: Annotated[int, Field(ge=500, le=200_000)] = 20_000
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    measure: Literal["uniform", "conditioned"] = "uniform"


class LearnedEffector(Contract):
    """What was learned for one effector; ``thesis_components`` is the size that the thesis takes for its kind."""

    frame: Literal["contact", "heading"]
    components: int
    thesis_components: int
    kl_nats: float
    kl_sd_nats: float
    held_out_log_likelihood: float
    bandwidth_m: float
    mode_m: tuple[float, float, float]


class LearnReachabilitySummary(Contract):
    """Summary of ``learn-reachability``."""

    robot: str
    robot_sha256: str
    samples: int
    tried: int
    rejected_share: float
    learned_on: str
    measure: str
    effectors: dict[str, LearnedEffector]
    warnings: list[Remark]
