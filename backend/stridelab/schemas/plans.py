"""Inputs and summaries of motion planning and contact planning."""

import math
from typing import Annotated, Final, Literal

from pydantic import BeforeValidator, Field, model_validator

from stridelab.schemas.base import Contract, Remark
from stridelab.schemas.methods import NODE_RATE_HZ, Formulation
from stridelab.schemas.scenarios import Friction, OneLine, Scenario, ScenarioContact, ScenarioSource, TerrainSurface

PLAN_STAGES: Final = ("check", "reachability", "centroidal", "whole body", "certificate", "replay", "export")
"""Stages of ``plan-motion`` in order: keys of ``stage_times_s``, and prefixes of its progress messages."""

Shape = Literal["constant", "cubic"]
Film = Literal["gif", "mp4"]
TIME_LIMIT_S: Final = 300.0
"""Maximum of the solver's time limit; the job itself ends after ten minutes."""

DURATION_RANGE: Final = (0.7, 1.4)
"""Default range of free phase durations, as multiples of the given duration.

With 0.6 to 1.6, the legs would swing too fast on long strides for the angular momentum of the plan.
"""
MIN_DURATION_FACTOR, MAX_DURATION_FACTOR = 0.1, 10.0
"""Bounds of ``duration_range``."""
MAX_PRICE_PER_S: Final = 1e3
MAX_DELAY_S: Final = 0.1
"""Maximum delay of the replay's control."""
MAX_IMPULSE_NS: Final = 1000.0
MAX_PUSHES: Final = 50
_ImpulsePart = Annotated[float, Field(ge=-MAX_IMPULSE_NS, le=MAX_IMPULSE_NS)]


class ReplayPush(Contract):
    """A push in the replay: a force at the centre of mass of ``link`` (null: the trunk) for 0.1 s.

    ``time_s`` is its start, from the start of the replay and not after the end of the motion. ``impulse_ns`` is the
    force times its duration, in world axes.
    """

    time_s: Annotated[float, Field(ge=0.0)]
    impulse_ns: tuple[_ImpulsePart, _ImpulsePart, _ImpulsePart]
    link: str | None = None


class ReplayOptions(Contract):
    """Disturbances of the replay, which neither the plan nor the control of the replay has.

    ``delay_s`` is the age of all readings that the control uses: joint angles and rates, and the inputs of the
    stabiliser; it is rounded to milliseconds. ``expected_delay_s`` is the delay for which the joint control allows:
    it predicts the joints from the torques that it commanded in that time. ``gains`` ``soft`` are those for 10 ms of
    delay. ``payload_kg`` is added to the trunk at its centre of mass. ``friction`` replaces that of all boxes. With
    ``sensors`` ``estimated``, noise is added to the stabiliser's inputs and the filter of chapter 2 estimates the
    centre of mass from joint angles and contact forces; the pose of the base remains that of the simulator.
    """

    pushes: Annotated[list[ReplayPush], Field(max_length=MAX_PUSHES)] = Field(default_factory=list)
    delay_s: Annotated[float, Field(ge=0.0, le=MAX_DELAY_S)] = 0.0
    expected_delay_s: Annotated[float, Field(ge=0.0, le=MAX_DELAY_S)] = 0.0
    gains: Literal["stiff", "soft"] = "stiff"
    payload_kg: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    friction: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    sensors: Literal["true", "estimated"] = "true"

    @property
    def description(self) -> str:
        """The disturbances in words."""
        pushes = [
            f"push of {math.hypot(*push.impulse_ns):.3g} N s at {push.time_s:g} s on {push.link or 'the trunk'}"
            for push in self.pushes
        ]
        others = {
            f"{self.payload_kg:g} kg on the trunk": self.payload_kg,
            f"friction {self.friction}": self.friction is not None,
            f"control {1e3 * self.delay_s:.0f} ms late": self.delay_s,
            f"{1e3 * self.expected_delay_s:.0f} ms expected": self.expected_delay_s,
            "soft gains": self.gains == "soft",
            "estimated centre of mass": self.sensors == "estimated",
        }
        return ", ".join([*pushes, *(text for text, given in others.items() if given)]) or "nothing"


def _replay_of(value: object) -> object:
    """Validate an object as options alone, so that its errors name its own fields and no alternative."""
    return ReplayOptions.model_validate(value) if isinstance(value, dict) else value


class PlanMotionInput(ScenarioSource):
    """Input of ``plan-motion``: either the id of a stored scenario or a complete scenario.

    ``formulation`` is the control: ``forces`` at the contact points, ``circular-cones`` (the same forces, in exact
    cones with every solver), or the ``wrench`` of all contacts in one cone. ``solver`` ``auto`` takes ``native``, the
    C++ solver, if it is available and supports the options, else ``casadi``: ipopt, then fatrop if ipopt fails. With
    ``forces``, ``native`` uses the exact cones and CasADi's solvers inscribed pyramids; the summary names the solver.
    ``node_rate_hz`` is the number of nodes per second in every phase; between nodes, forces are ``constant``, or with
    ``shape`` ``cubic`` one continuous spline each. Null takes splines for forces that a whole body is to follow, if
    they apply, else constants. ``time_limit_s`` (processor time) replaces the default of one minute; fatrop cannot be
    interrupted, so its iterations are limited instead, and ``auto`` does not use it then. With ``free_durations``, the
    solver optimises the phase durations between the two multiples in ``duration_range``, at constant total duration;
    with ``circular-cones``, only ``native`` can do so. ``measure`` selects the bundled densities (null: the default).
    ``replay`` is true, or its disturbances. ``film`` needs ffmpeg in the worker; ``mcap`` is a log for Foxglove, Rerun.

    With ``price_per_s`` and ``free_durations``, the total duration is free as well and costs this much per second.
    ``fastest`` searches the fastest pace at which the motion is certified and, with a ``replay``, completed: at pace p,
    every phase of the scenario lasts its duration over p. ``summary.pace`` lists the paces that were tried.
    """

    formulation: Formulation = "forces"
    solver: Literal["auto", "native", "casadi", "ipopt", "fatrop"] = "auto"
    node_rate_hz: Annotated[float, Field(ge=NODE_RATE_HZ[0], le=NODE_RATE_HZ[1])] = 10.0
    shape: Shape | None = None
    time_limit_s: Annotated[float, Field(gt=0.0, le=TIME_LIMIT_S)] | None = None
    free_durations: bool = False
    duration_range: tuple[
        Annotated[float, Field(ge=MIN_DURATION_FACTOR, le=1.0)], Annotated[float, Field(ge=1.0, le=MAX_DURATION_FACTOR)]
    ] = DURATION_RANGE
    price_per_s: Annotated[float, Field(ge=0.0, le=MAX_PRICE_PER_S)] | None = None
    fastest: bool = False
    measure: Literal["uniform", "conditioned"] | None = None
    whole_body: bool = True
    replay: Annotated[bool | ReplayOptions, BeforeValidator(_replay_of)] = False
    film: Film | None = None
    mcap: bool = False

    @model_validator(mode="after")
    def _check_options(self) -> "PlanMotionInput":
        if self.replay and not self.whole_body:
            raise ValueError("a replay needs whole_body")
        if not self.whole_body and (without := [k for k in ("film", "mcap", "fastest") if getattr(self, k)]):
            raise ValueError(f"{without[0]}: requires whole_body")
        if self.fastest and isinstance(self.replay, ReplayOptions) and self.replay.pushes:
            raise ValueError("fastest: pushes have times in one motion; search the pace without them first")
        if self.price_per_s is not None and not self.free_durations:
            raise ValueError("price_per_s: requires free_durations")
        if self.free_durations and self.solver == "fatrop":
            raise ValueError("free_durations: fatrop solves stage by stage and cannot couple stages; use ipopt")
        if self.shape == "cubic" and (self.formulation == "wrench" or self.solver == "fatrop"):
            raise ValueError(
                "shape: cubic requires forces, and is not supported by fatrop, which solves stage by stage"
            )
        if self.free_durations and self.formulation == "circular-cones" and self.solver not in ("auto", "native"):
            raise ValueError("free_durations: CasADi does not converge with circular-cones; use forces or wrench")
        return self


class CertificateCheck(Contract):
    """One check of the motion: ``limit`` is a lower bound of ``value`` if ``at_least``, else an upper bound."""

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
    """Certificate of a motion: all checks, and whether all passed."""

    passed: bool
    checks: list[CertificateCheck]


class ReplayCollision(Contract):
    """An unplanned contact between two links, or between a link or effector and a surface.

    ``time_s`` is the time of the first contact, ``force_max_n`` the largest force between the two.
    """

    first: str
    second: str
    time_s: float
    force_max_n: float


class ReplayLeftPlan(Contract):
    """A plan left at ``time_s`` for recoveries of ``steps`` steps, the last of which ended at rest (``rested``).

    It was resumed at ``resumed_s`` (null: never), or not, for the reason ``not_resumed``. ``arrived`` if every effector
    of its last contacts ends within 5 cm of its place.
    """

    time_s: float
    steps: int
    rested: bool
    resumed_s: float | None = None
    not_resumed: str = ""
    arrived: bool = False


class ReplaySummary(Contract):
    """Result of the replay of the motion in a physics simulation.

    ``completed``: the robot does not fall, there are no unplanned contacts, no loaded sole slips by more than 20 mm, no
    commanded torque exceeds 1.2 times its limit, and every planned hand contact is loaded in place for 95 % of its
    duration. ``remarks`` lists the conditions that are not met. ``fall_time_s`` is null if the robot does not fall.
    ``options`` are the disturbances, null if there are none. ``proved_lost`` is set only if the robot falls after a
    push: whether no motion would have saved it, by a sufficient condition; false proves nothing.
    ``left_plan`` is set if the robot left its plan for a recovery; ``completed`` then requires that it arrived.
    ``slip_max_m`` equals ``foot_slip_max_m``; ``collisions`` is the number of pairs in ``collided``. Plans of earlier
    versions lack the last six fields, and their ``completed`` only means that the robot did not fall.
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
    options: ReplayOptions | None = None
    proved_lost: bool | None = None
    left_plan: ReplayLeftPlan | None = None


class StoppedMotion(Contract):
    """The point at which the whole body cannot follow the plan any longer.

    ``level`` is the first violated level of the task hierarchy, counted from 0; ``names`` lists the violated
    constraints with their joints or effectors, the worst first. The motion ends at ``time_s``.
    """

    time_s: float
    phase: int
    level: int
    level_name: str
    names: list[str]


class CostWeights(Contract):
    """Weights of the cost terms; each weighted term is in seconds.

    ``com_acceleration`` is in s⁴/m² and ``momentum_rate`` in 1/(N m)²; ``likelihood`` weights the negative natural
    logarithm of densities in 1/m³. ``surface_force`` and ``point_force`` weight the squared forces of soles and hands,
    in body weights; they are not part of ``objective``.
    """

    com_acceleration: float
    momentum_rate: float
    likelihood: float
    surface_force: float
    point_force: float


class PlanVerification(Contract):
    """Independent verification of the centroidal solution, without the solver."""

    dynamics_gap: float
    terminal_gap: float
    cone_margin_n: float
    normal_force_min_n: float


class PhaseDuration(Contract):
    """Duration of a phase: given by the scenario, and chosen by the solver."""

    given_s: float
    chosen_s: float


class PaceAttempt(Contract):
    """A motion at one pace; ``completed`` is null without a replay, ``reason`` is empty if it passed."""

    pace: float
    duration_s: float
    certified: bool
    completed: bool | None = None
    reason: str = ""


class PaceSearch(Contract):
    """The fastest pace that passed, and all attempts in order; ``finished`` is false if time ran out before."""

    pace: float
    given_duration_s: float
    attempts: list[PaceAttempt]
    finished: bool


class AgreementPass(Contract):
    """Difference in angular momentum between plan and whole body (maximum and RMS), and CPU time of the plan."""

    mismatch_max_nms: float
    mismatch_rms_nms: float
    solve_time_s: float


class PlanMotionSummary(Contract):
    """Summary of ``plan-motion``.

    ``objective`` is the sum of ``cost_terms`` without ``surface_force`` and ``point_force``. The solver minimises these
    two as well if the contact forces are the control; with the wrench, they are the cost of the forces that are
    computed from it afterwards. ``formulation``, ``shape``, ``measure``, ``node_rate_hz``, ``weights`` and
    ``kkt_error`` (largest violation of the first-order conditions, in units of the solver) are null in results of
    versions without them. ``phase_durations`` is null if the durations are those of the scenario.
    ``normal_force_max_n`` limits the hands to the load capacity of the arms; it is empty with the wrench as control.
    ``solver_because`` is the reason why the C++ solver was not used, else null. ``stopped`` is set only in a failed job
    whose body cannot follow the plan. ``agreement`` has one entry per iteration of plan and whole body; there are
    several if a stride is longer than 0.9 m or a swing shorter than 0.8 s. ``pace`` is null unless the request asks for
    the ``fastest`` pace.
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
    pace: PaceSearch | None = None
    agreement: list[AgreementPass] = Field(default_factory=list)
    warnings: list[Remark]


class StanceInput(Contract):
    """Contacts of all effectors in contact, as in a phase."""

    contacts: Annotated[list[ScenarioContact], Field(min_length=1, max_length=16)]


class PlanContactsInput(Contract):
    """Input of ``plan-contacts``: stances ``start`` and ``goal``, each with both feet.

    A hand with a contact in either of them may use the rails. ``certify`` is the largest number of plans of which the
    motion is computed and certified: where one fails, the next has to avoid the step at which it failed.
    """

    robot: Annotated[str, Field(min_length=1, max_length=60)]
    terrain: Annotated[list[TerrainSurface], Field(min_length=1, max_length=200)]
    start: StanceInput
    goal: StanceInput
    friction: Friction = 0.3
    name: OneLine | None = None
    certify: Annotated[int, Field(ge=0, le=6)] = 0


class PlanContactsSummary(Contract):
    """Summary of ``plan-contacts``: a scenario that passes ``POST /scenarios/check``.

    ``objective_m`` is the total deviation of the placements from even steps; ``programs`` is the number of
    mixed-integer programs solved, one per number of steps and leading foot. With ``certify``, ``certified`` states
    whether the motion passes its certificate, and ``failures`` names phase and checks of every plan that did not.
    """

    scenario: Scenario
    steps: int
    duration_s: float
    objective_m: float
    programs: int
    solve_time_s: float
    warnings: list[Remark]
    certified: bool | None = None
    failures: list[str] = Field(default_factory=list)


class PlanMotionTask(Contract):
    """Task of ``plan-motion``, with the resolved scenario."""

    scenario: Scenario
    input: PlanMotionInput


class PlanContactsTask(Contract):
    """Task of ``plan-contacts``."""

    input: PlanContactsInput
