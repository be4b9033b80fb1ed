"""The optimal control problem (4.20) with the forces of the contact points as control, u_f.

    min   sum_k int  w_c |c''|^2 + w_L |L_c'|^2 - sum_i log p_i(c)  dt           (4.20a)
    s.t.  m c'' = sum f + m g,   L_c' = sum (p - c) x f                          (4.2), which is (4.20b)
          f in the friction cone of its contact                                  (4.20c)
          c, c', L_c given at both ends, c' = L_c = c'' = 0 at the last          (4.20d), (4.20e)

The condition on the last acceleration is ours: rest that stays rest. So is the weight on the forces: a small one on
all makes them unique, a larger one on points keeps a hand from carrying what its arm cannot
(docs/theory/centroidal-problem.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.boundary_conditions import AT_REST, UNBOUNDED, PathBounds, Start, Terminal
from stridelab.centroidal.control import Control, Touch
from stridelab.centroidal.force_splines import Shape, limb_times_s
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.point_forces import PYRAMIDS
from stridelab.contacts.sequence import Contact, ContactSequence
from stridelab.conventions import GRAVITY_M_S2, Points, Series, Vector3
from stridelab.errors import Fault, InvalidInput
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.robots.robot import Effector

NODES_PER_PHASE_MIN = 2


@dataclass(frozen=True)
class Weights:
    """Weights of the cost: ``com_acceleration`` in 1 / (m/s^2)^2, ``momentum_rate`` in 1 / (Nm)^2, as in 4.5.1.

    ``surface_force`` and ``point_force`` weigh ``sum |f / (m g)|^2`` over the points of surfaces (soles) and of point
    effectors (hands); ``likelihood`` the log-density term, 1 in the thesis. Raises ``InvalidInput``
    (``weight-out-of-range``), naming them, for weights that are negative or not finite.
    """

    com_acceleration: float = 10.0
    momentum_rate: float = 10.0
    likelihood: float = 1.0
    surface_force: float = 1.0
    point_force: float = 300.0

    def __post_init__(self) -> None:
        faults = [
            Fault(f"weights.{name}", f"must be zero or positive, not {value}")
            for name, value in vars(self).items()
            if not 0.0 <= value < np.inf
        ]
        if faults:
            named = ", ".join(fault.where for fault in faults)
            raise InvalidInput("weight-out-of-range", f"These weights must be zero or positive: {named}.", faults)


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes in time: ``n`` of them, and per interval its phase and its length (s)."""

    time_s: Float[np.ndarray, "n"]
    phase: Int[np.ndarray, "m"]
    step_s: Float[np.ndarray, "m"]


@dataclass(frozen=True, eq=False)
class CentroidalProblem:
    """One motion to plan, from ``com_start_m`` to ``com_end_m``, from rest to rest unless said otherwise.

    ``effectors`` and ``proxies`` are looked up by the names that the sequence uses; without any proxies there is no
    likelihood term, and with some every effector that touches needs one. Surfaces are shrunk by ``contact_margin_m``
    (x, y) on every side. ``control`` is u: forces (``Pyramids``, ``CircularCones``) or the wrench (``ContactWrench``).
    Its forces are ``constant`` between nodes, or with ``shape`` "cubic" one spline each (``spline``). ``durations`` and
    ``placements`` are given, unless the solver may choose them. ``limbs_nm`` is the rate of the angular momentum about
    the CoM that the limbs' motion takes between ``limb_times_s``, N m: the cost then weighs what differs from it.
    The motion begins as ``start`` says and ends at rest or ``capturable``, within ``bounds``.

    Raises ``InvalidInput`` for what cannot be a problem at all: ``effector-unknown``, ``proxy-missing``,
    ``phase-without-duration``, ``mass-out-of-range``, ``node-rate-out-of-range``, ``com-not-finite``, and
    ``placements-need-forces`` where contacts are to move and the control's cones would have to follow,
    ``bounds-need-forces`` where forces are bounded and the control has none, ``shape-needs-forces`` and
    ``shape-needs-durations`` for splines of a wrench, whose cones differ from phase to phase, or of free durations, and
    ``limbs-need-grid`` where the limbs' rates do not fit the grid, which free durations have not.
    """

    sequence: ContactSequence
    mass_kg: float
    effectors: Mapping[str, Effector]
    proxies: Mapping[str, Proxy]
    com_start_m: Vector3
    com_end_m: Vector3
    weights: Weights = Weights()
    node_rate_hz: float = 10.0
    contact_margin_m: tuple[float, float] = (0.02, 0.015)
    control: Control = PYRAMIDS
    shape: Shape = "constant"
    start: Start = AT_REST
    terminal: Terminal = "rest"
    bounds: PathBounds = UNBOUNDED
    durations: FreeDurations | None = None
    placements: FreePlacements | None = None
    limbs_nm: Float[np.ndarray, "m 3"] | None = None

    def __post_init__(self) -> None:
        unknown = [name for name in self.sequence.effectors if name not in self.effectors]
        if unknown:
            faults = [Fault(name, f"the robot has no effector {name!r}") for name in unknown]
            raise InvalidInput("effector-unknown", f"The contact sequence uses {', '.join(unknown)}.", faults)
        missing = [name for name in self.sequence.effectors if self.proxies and name not in self.proxies]
        if missing:
            faults = [Fault(name, f"there is no reachability density of {name!r}") for name in missing]
            raise InvalidInput("proxy-missing", f"No reachability density was given for {', '.join(missing)}.", faults)
        faults = [
            Fault(f"phases[{i}].duration_s", f"must be positive and finite, not {phase.duration_s}")
            for i, phase in enumerate(self.sequence.phases)
            if not 0.0 < phase.duration_s < np.inf
        ]
        if faults:
            named = ", ".join(fault.where for fault in faults)
            raise InvalidInput("phase-without-duration", f"Every phase must take some time: {named}.", faults)
        if not 0.0 < self.mass_kg < np.inf:
            raise InvalidInput("mass-out-of-range", f"The robot's mass must be positive, not {self.mass_kg} kg.")
        if not np.isfinite([self.com_start_m, self.com_end_m]).all():
            raise InvalidInput("com-not-finite", "The centre of mass at the start and at the end must be numbers.")
        if not 0.0 < self.node_rate_hz < np.inf:
            raise InvalidInput("node-rate-out-of-range", f"There cannot be {self.node_rate_hz} nodes per second.")
        if self.bounds.normal_force_max_n and not self.control.has_point_forces:
            raise InvalidInput(
                "bounds-need-forces", "Normal forces can be bounded with forces as control only, not with the wrench."
            )
        if self.shape == "cubic" and not self.control.has_point_forces:
            raise InvalidInput(
                "shape-needs-forces",
                "Continuous controls are forces: where phases meet, a wrench would have to be in the cones of both.",
                [Fault("shape", "cubic needs forces as control")],
            )
        if self.shape == "cubic" and self.durations is not None:
            raise InvalidInput(
                "shape-needs-durations",
                "With continuous controls the durations of the phases must be given: they decide how the splines join.",
                [Fault("shape", "cubic needs given durations")],
            )
        if self.limbs_nm is not None and (
            self.durations is not None or self.limbs_nm.shape != (len(self.limb_times_s()) - 1, 3)
        ):
            raise InvalidInput(
                "limbs-need-grid",
                "The limbs' angular momentum is given per interval: it needs given durations, and one rate for every "
                "interval, with continuous forces four.",
                [Fault("limbs_nm", "must have one row for every interval of the grid, of splines four")],
            )
        if self.placements is not None and not self.control.shifts_with_its_contacts:
            raise InvalidInput(
                "placements-need-forces",
                "Contacts can be moved with forces as control only: the cone of the wrench is that of given contacts.",
            )

    @property
    def weight_n(self) -> float:
        """``m |g|``, the unit of force inside the solver."""
        return self.mass_kg * GRAVITY_M_S2

    def contact(self, effector: str, phase: int) -> Contact:
        """The contact of an effector in a phase in which it touches."""
        return self.sequence.phases[phase].contacts[effector]

    def points_m(self, effector: str) -> Points:
        """Contact points ``(k, 3)`` in the contact frame, the rectangle shrunk."""
        tool = self.effectors[effector]
        corners = tool.points_m()
        if tool.contact_half_size_m is None:
            return corners
        shrink = 1.0 - np.array(self.contact_margin_m) / np.array(tool.contact_half_size_m)
        return np.asarray(corners * np.append(np.clip(shrink, 0.0, 1.0), 1.0))

    def force_weight(self, effector: str) -> float:
        """Weight on ``sum |f / (m g)|^2`` of this effector's points."""
        return self.weights.point_force if self.effectors[effector].kind == "point" else self.weights.surface_force

    def touches(self, phase: int, origin_m: Vector3) -> tuple[Touch, ...]:
        """What touches in a phase, seen from ``origin_m``."""
        found = []
        for name, contact in self.sequence.phases[phase].contacts.items():
            at, kind = contact.placement, self.effectors[name].kind
            points_m = at.act(self.points_m(name)) - origin_m
            found.append(Touch(name, kind, points_m, at.rotation, contact.friction, self.force_weight(name)))
        return tuple(found)

    def grid(self) -> Grid:
        """``node_rate_hz`` nodes per second of every phase, at least two intervals each, evenly spaced within."""
        counts = [max(NODES_PER_PHASE_MIN, round(p.duration_s * self.node_rate_hz)) for p in self.sequence.phases]
        phase = np.repeat(np.arange(len(counts)), counts)
        step: Series = np.repeat([p.duration_s / n for p, n in zip(self.sequence.phases, counts, strict=True)], counts)
        return Grid(time_s=np.concatenate([[0.0], np.cumsum(step)]), phase=phase, step_s=step)

    def limb_times_s(self) -> Float[np.ndarray, "times"]:
        """Times between which ``limbs_nm`` are means: the nodes, of splines so much around every instant of Gauss."""
        return limb_times_s(self.grid().time_s, self.shape)


def standing_com_m(
    phase_contacts: Mapping[str, Contact], height_m: float, effectors: Mapping[str, Effector]
) -> Vector3:
    """Where the CoM stands over a phase: ``height_m`` above the mean of its surface contacts.

    Raises ``InvalidInput`` (``no-surface-contact``) where nothing but points touches.
    """
    soles = [c.placement.position_m for name, c in phase_contacts.items() if effectors[name].kind == "surface"]
    if not soles:
        raise InvalidInput(
            "no-surface-contact", "The robot cannot stand at rest in a phase without a sole on a surface."
        )
    return np.asarray(np.mean(soles, axis=0) + np.array([0.0, 0.0, height_m]))
