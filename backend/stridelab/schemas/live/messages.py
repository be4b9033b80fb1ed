"""A live robot: the request for a session, what clients send to it, and what it sends to those who watch."""

from typing import Annotated, Final, Literal

from pydantic import Field, TypeAdapter, model_validator

from stridelab.schemas.base import Contract, Problem
from stridelab.schemas.plans import MAX_DELAY_S, MAX_IMPULSE_NS

REWIND_S: Final = 10.0
"""How far a rewind goes back."""
MAX_AHEAD_M_S: Final = 0.4
MAX_LEFT_M_S: Final = 0.2
MAX_TURN_RAD_S: Final = 0.5
STEER_HOLD_S: Final = 1.0
"""How long a command to walk is followed unless it is renewed."""
LivePhase = Literal["planning", "running", "paused", "fallen", "failed"]
_Part = Annotated[float, Field(ge=-MAX_IMPULSE_NS, le=MAX_IMPULSE_NS)]
_Vector = tuple[float, float, float]


_Ahead = Annotated[float, Field(ge=-MAX_AHEAD_M_S, le=MAX_AHEAD_M_S)]
_Left = Annotated[float, Field(ge=-MAX_LEFT_M_S, le=MAX_LEFT_M_S)]
_Turn = Annotated[float, Field(ge=-MAX_TURN_RAD_S, le=MAX_TURN_RAD_S)]


class LiveInput(Contract):
    """The motion of a session: that of a stored scenario, or a level walk of a robot.

    With ``velocity`` (ahead and to the left in m/s, turning in rad/s) the robot walks with it from the beginning on,
    in place of its plan, until it is steered.
    """

    scenario_id: str | None = None
    robot: str | None = None
    velocity: tuple[_Ahead, _Left, _Turn] | None = None

    @model_validator(mode="after")
    def _check_source(self) -> "LiveInput":
        if (self.scenario_id is None) == (self.robot is None):
            raise ValueError("give either scenario_id or robot")
        return self


class LiveSettings(Contract):
    """What can be changed while the robot moves; of these values, its control has ``expected_delay_s`` only.

    ``friction`` replaces that of all boxes, null restores it. ``payload_kg`` is added to the trunk, ``delay_s`` is
    the age of all readings of the control, ``expected_delay_s`` that for which the joint control allows.
    ``floor_time_s`` is the time constant with which contacts with the terrain recover from penetration: the larger,
    the softer the floor. ``pace`` is the requested ratio of simulated to real time.
    """

    friction: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    payload_kg: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    delay_s: Annotated[float, Field(ge=0.0, le=MAX_DELAY_S)] = 0.0
    expected_delay_s: Annotated[float, Field(ge=0.0, le=MAX_DELAY_S)] = 0.0
    floor_time_s: Annotated[float, Field(ge=0.005, le=0.2)] = 0.02
    pace: Annotated[float, Field(ge=0.05, le=1.0)] = 1.0


class LivePush(Contract):
    """A push: ``impulse_ns`` (world axes) within 0.1 s at the centre of mass of ``link`` (null: the trunk).

    ``number`` comes back as ``pushes.number`` of the frames that show it.
    """

    type: Literal["push"]
    impulse_ns: tuple[_Part, _Part, _Part]
    link: Annotated[str, Field(max_length=200)] | None = None
    number: Annotated[int, Field(ge=0, le=2**53)] | None = None


class LiveSet(Contract):
    """New values of some settings; what is left out stays as it is."""

    type: Literal["set"]
    friction: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    payload_kg: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0
    delay_s: Annotated[float, Field(ge=0.0, le=MAX_DELAY_S)] = 0.0
    expected_delay_s: Annotated[float, Field(ge=0.0, le=MAX_DELAY_S)] = 0.0
    floor_time_s: Annotated[float, Field(ge=0.005, le=0.2)] = 0.02
    pace: Annotated[float, Field(ge=0.05, le=1.0)] = 1.0

    def applied_to(self, settings: LiveSettings) -> LiveSettings:
        """``settings`` with the values that were given."""
        return settings.model_copy(update=self.model_dump(exclude={"type"}, exclude_unset=True))


class LiveSteer(Contract):
    """Walk at this velocity: ahead and to the left of the robot in m/s, turning to the left in rad/s.

    The first one leaves the plan. Without another one the robot stops after ``STEER_HOLD_S`` of simulated time.
    """

    type: Literal["steer"]
    ahead_m_s: _Ahead = 0.0
    left_m_s: _Left = 0.0
    turn_rad_s: _Turn = 0.0


class LiveOrder(Contract):
    """``pause``, ``resume``, ``rewind`` by ten seconds, or ``restart`` from the beginning of the motion."""

    type: Literal["pause", "resume", "rewind", "restart"]


LiveCommand = Annotated[LivePush | LiveSet | LiveSteer | LiveOrder, Field(discriminator="type")]
LIVE_COMMAND: Final[TypeAdapter[LivePush | LiveSet | LiveSteer | LiveOrder]] = TypeAdapter(LiveCommand)


class LiveSession(Contract):
    """A session as a list shows it."""

    session_id: str
    title: str
    robot: str
    scenario_id: str | None = None
    phase: LivePhase
    n_watching: int
    page: str = Field(description="address of its page")
    socket: str = Field(description="address of its websocket")


class LiveSessions(Contract):
    """Open sessions, the newest first."""

    items: list[LiveSession]


class LiveRobot(Contract):
    """What does not change during a session: links in the order of ``frame.links``, mass, duration, certificate.

    ``soles_m`` are the half edges of the soles. ``may_steer`` if the robot can walk at a commanded velocity.
    """

    links: list[str]
    effectors: list[str]
    mass_kg: float
    duration_s: float
    certified: bool | None = None
    soles_m: dict[str, tuple[float, float]] = Field(default_factory=dict)
    may_steer: bool = False


class LiveState(Contract):
    """``state``: sent to each new viewer, and to all after every change and once a second.

    ``pace`` is the ratio of simulated to real time over the last two seconds; the simulator never skips a step.
    ``can_rewind_s`` is how far a rewind would go back now.
    """

    type: Literal["state"] = "state"
    phase: LivePhase
    message: str = ""
    fraction: float = 0.0
    pace: float | None = None
    settings: LiveSettings = Field(default_factory=LiveSettings)
    can_rewind_s: float = 0.0
    n_watching: int = 0
    may_push: bool = False
    robot: LiveRobot | None = None
    problem: Problem | None = None


class LivePushState(Contract):
    """The latest push: its ``number``, the index of its link in ``robot.links`` if it is drawn, its force now.

    ``since_s`` is the simulated time since its start.
    """

    number: int
    link: int | None
    impulse_ns: _Vector
    force_n: _Vector
    since_s: float


class LiveFoothold(Contract):
    """A place where a sole is to land next, with its heading."""

    effector: str
    position_m: _Vector
    yaw_rad: float


class LiveFrame(Contract):
    """``frame``: one instant; ``links`` are poses ``px, py, pz, qw, qx, qy, qz`` in the world.

    ``doing`` is ``plan`` while the robot follows its plan, ``steered`` while it walks or stands as commanded,
    ``recovery`` once it steps to stay upright, ``fallen``. After a recovery, ``is_planning`` says that the rest of the
    plan is being computed, and ``not_resumed`` why it is not resumed from there, else empty. ``velocity`` is the
    commanded one as it is followed (ahead, left, turning). ``capture_m`` is the capture point, at the height
    ``ground_m`` of the lowest sole, ``foothold_m`` the place that the swinging sole is aimed at, ``effectors_m`` the
    position and ``forces_n`` the contact force of each effector. ``horizon_m`` is the path of the CoM that the control
    has in mind for the next 2.5 s, ``footholds`` are the next places of the soles.
    """

    type: Literal["frame"] = "frame"
    time_s: float
    plan_time_s: float
    doing: Literal["plan", "steered", "recovery", "fallen"]
    steps: int
    is_planning: bool = False
    not_resumed: str = ""
    velocity: _Vector | None = None
    links: list[list[float]]
    com_m: _Vector
    capture_m: tuple[float, float]
    ground_m: float
    contacts: list[str]
    effectors_m: dict[str, _Vector]
    forces_n: dict[str, _Vector]
    foothold_m: _Vector | None = None
    horizon_m: list[_Vector] = Field(default_factory=list)
    footholds: list[LiveFoothold] = Field(default_factory=list)
    push: LivePushState | None = None


class LiveFall(Contract):
    """``fall``: when the robot fell, and which limits ran out before.

    ``proved_lost`` is True if no motion within the premises of the proof would have come to rest; null where the proof
    does not apply (stairs, rails, no push).
    """

    type: Literal["fall"] = "fall"
    time_s: float
    summary: str
    reasons: list[str]
    proved_lost: bool | None = None


class LiveRefused(Contract):
    """``refused``: a command of this viewer that was not carried out."""

    type: Literal["refused"] = "refused"
    code: str
    message: str
