"""The optimal control problem (4.20) with the forces of the contact points as control, u_f.

    min   sum_k int  w_c |c''|^2 + w_L |L_c'|^2 - sum_i log p_i(c)  dt           (4.20a)
    s.t.  m c'' = sum f + m g,   L_c' = sum (p - c) x f                          (4.2), which is (4.20b)
          f in the friction cone of its contact                                  (4.20c)
          c, c', L_c given at both ends, c' = L_c = c'' = 0 at the last          (4.20d), (4.20e)

Two additions to the thesis: zero acceleration at the end, so that the rest is an equilibrium, and weights on the
forces. A small weight on all forces makes them unique, a larger one on point effectors keeps hands within what their
arms can carry (docs/theory/centroidal-problem.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from stridelab.centroidal.boundary_conditions import (
    AT_REST,
    UNBOUNDED,
    CaptureRegion,
    PathBounds,
    Start,
    Terminal,
    capture_region,
)
from stridelab.centroidal.control import ContactPatch, Control
from stridelab.centroidal.force_splines import Shape, limb_times_s
from stridelab.centroidal.free_variables import FreeDurations, FreePlacements
from stridelab.centroidal.point_forces import PYRAMIDS
from stridelab.centroidal.state_density import StateDensity
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
    """One motion to plan, from ``com_start_m`` to ``com_end_m``, by default from rest to rest.

    ``effectors`` and ``proxies`` are keyed by the effector names of the sequence; without any proxies there is no
    likelihood term, otherwise every effector in contact needs one. Surfaces are shrunk by ``contact_margin_m`` (x, y)
    on every side, and forces use ``rail_friction_share`` of the friction of rails. ``control`` is u: forces
    (``Pyramids``, ``CircularCones``) or the wrench (``ContactWrench``), constant between nodes, or for ``shape``
    "cubic" splines (``force_splines``). ``durations`` and ``placements`` are fixed unless given as free variables.
    ``limbs_nm`` (N m) is the momentum rate of the limbs about the CoM, averaged
    between ``limb_times_s``; the cost then weighs the difference from it. ``reference_m_s2`` is an acceleration of the
    CoM, averaged between the same times; the cost then weighs ``|c'' - a|^2`` instead of ``|c''|^2``.
    ``state_densities`` adds ``-log p(c', L) - log p(c'', L')`` of the contacts of these effectors, (4.11), with the
    weight ``likelihood``: the former at the first node of an interval, the latter of its mean rates. The motion begins
    at ``start`` and ends at rest, ``capturable``, or ``moving`` with the velocity and the momentum of ``end``, within
    ``bounds``.

    Raises ``InvalidInput`` for inconsistent problems: ``effector-unknown``, ``proxy-missing``,
    ``phase-without-duration``, ``mass-out-of-range``, ``node-rate-out-of-range``, ``com-not-finite``,
    ``bounds-need-grid`` for heights that are not one per interval of a given grid, ``placements-need-forces`` for
    free placements with a control whose cones depend on them, ``bounds-need-forces`` for force bounds with a control
    without forces, ``shape-needs-forces`` and ``shape-needs-durations`` for splines of a wrench, whose cones differ
    from phase to phase, or with free durations, ``limbs-need-grid`` if the limbs' rates do not match the grid or
    durations are free, and ``reference-needs-grid`` for the reference likewise; ``densities-need-constant-forces`` for
    densities of the state with splines or free durations.
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
    rail_friction_share: float = 1.0
    control: Control = PYRAMIDS
    shape: Shape = "constant"
    start: Start = AT_REST
    terminal: Terminal = "rest"
    end: Start = AT_REST
    bounds: PathBounds = UNBOUNDED
    durations: FreeDurations | None = None
    placements: FreePlacements | None = None
    limbs_nm: Float[np.ndarray, "m 3"] | None = None
    reference_m_s2: Float[np.ndarray, "m 3"] | None = None
    state_densities: Mapping[str, StateDensity] = field(default_factory=dict)

    def __post_init__(self) -> None:
        unknown = [name for name in self.sequence.effectors if name not in self.effectors]
        if unknown:
            faults = [Fault(name, f"the robot has no effector {name!r}") for name in unknown]
            raise InvalidInput(
                "effector-unknown", f"The contact sequence uses unknown effectors: {', '.join(unknown)}.", faults
            )
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
            raise InvalidInput("phase-without-duration", f"Every phase needs a positive duration: {named}.", faults)
        if not 0.0 < self.mass_kg < np.inf:
            raise InvalidInput("mass-out-of-range", f"The robot's mass must be positive, not {self.mass_kg} kg.")
        if not np.isfinite([self.com_start_m, self.com_end_m]).all():
            raise InvalidInput("com-not-finite", "The centre of mass at the start and at the end must be finite.")
        if not 0.0 < self.node_rate_hz < np.inf:
            raise InvalidInput("node-rate-out-of-range", f"The node rate must be positive, not {self.node_rate_hz} Hz.")
        if self.bounds.normal_force_max_n and not self.control.has_point_forces:
            raise InvalidInput(
                "bounds-need-forces", "Normal forces can only be bounded with forces as control, not with the wrench."
            )
        if self.bounds.com_between_m is not None and (
            self.durations is not None or len(self.bounds.com_between_m) != len(self.grid().phase)
        ):
            raise InvalidInput(
                "bounds-need-grid",
                "Bounds on the height of the centre of mass need fixed durations and one row per interval of the grid.",
                [Fault("bounds.com_between_m", "must have one row per interval of the grid")],
            )
        if self.shape == "cubic" and not self.control.has_point_forces:
            raise InvalidInput(
                "shape-needs-forces",
                "Continuous controls need forces: between two phases a wrench would have to be in the cones of both.",
                [Fault("shape", "cubic needs forces as control")],
            )
        if self.shape == "cubic" and self.durations is not None:
            raise InvalidInput(
                "shape-needs-durations",
                "Continuous controls need fixed phase durations, which determine how the splines join.",
                [Fault("shape", "cubic needs fixed durations")],
            )
        if self.limbs_nm is not None and (
            self.durations is not None or self.limbs_nm.shape != (len(self.limb_times_s()) - 1, 3)
        ):
            raise InvalidInput(
                "limbs-need-grid",
                "The limbs' momentum rate needs fixed durations and one row per interval, or four with continuous "
                "forces.",
                [Fault("limbs_nm", "must have one row per interval of the grid, or four for splines")],
            )
        if self.reference_m_s2 is not None and (
            self.durations is not None or self.reference_m_s2.shape != (len(self.limb_times_s()) - 1, 3)
        ):
            raise InvalidInput(
                "reference-needs-grid",
                "A reference acceleration needs fixed durations and one row per interval, or four with continuous "
                "forces.",
                [Fault("reference_m_s2", "must have one row per interval of the grid, or four for splines")],
            )
        if self.state_densities and (self.shape != "constant" or self.durations is not None):
            raise InvalidInput(
                "densities-need-constant-forces",
                "Densities of velocity and rates need forces that are constant between nodes, and fixed durations.",
                [Fault("state_densities", "needs constant forces and fixed durations")],
            )
        if self.placements is not None and not self.control.shifts_with_its_contacts:
            raise InvalidInput(
                "placements-need-forces",
                "Contacts can only be moved with forces as control: the cone of the wrench is fixed to its contacts.",
            )

    @property
    def weight_n(self) -> float:
        """``m |g|``, the unit of force inside the solver."""
        return self.mass_kg * GRAVITY_M_S2

    def contact(self, effector: str, phase: int) -> Contact:
        """The contact of an effector in a phase."""
        return self.sequence.phases[phase].contacts[effector]

    def usable_friction(self, effector: str, phase: int) -> float:
        """Friction that the forces of a contact may use."""
        contact = self.contact(effector, phase)
        on_rail = any(contact.surface == rail.name for rail in self.sequence.terrain.rails)
        return contact.friction * (self.rail_friction_share if on_rail else 1.0)

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

    def contact_patches(self, phase: int, origin_m: Vector3) -> tuple[ContactPatch, ...]:
        """Contacts of a phase, relative to ``origin_m``."""
        patches = []
        for name, contact in self.sequence.phases[phase].contacts.items():
            placement, kind = contact.placement, self.effectors[name].kind
            points_m = placement.act(self.points_m(name)) - origin_m
            patches.append(
                ContactPatch(
                    name, kind, points_m, placement.rotation, self.usable_friction(name, phase), self.force_weight(name)
                )
            )
        return tuple(patches)

    def com_height_windows_m(self, grid: Grid | None = None) -> Float[np.ndarray, "intervals 2"]:
        """Lowest and highest CoM height per interval, above the CoM at the start; infinite where there is no bound.

        They hold at the first node of the interval, except the start. ``grid`` is the problem's own unless given.
        Raises ``InvalidInput`` (``no-surface-contact``) for bounds above the soles if none has been in contact so far.
        """
        own, bounds = self.grid(), self.bounds
        grid = grid or own
        windows_m = np.tile([-np.inf, np.inf], (len(grid.phase), 1))
        if bounds.com_height_m is not None:
            ground_m = np.array([self._ground_m(i) for i in range(len(self.sequence.phases))])
            windows_m = ground_m[grid.phase, None] + np.array(bounds.com_height_m)
        if bounds.com_between_m is not None:
            own_interval = np.searchsorted(own.time_s, grid.time_s[:-1] + 1e-9, side="right") - 1
            lowest_m, highest_m = bounds.com_between_m[own_interval].T
            windows_m = np.column_stack([np.maximum(windows_m[:, 0], lowest_m), np.minimum(windows_m[:, 1], highest_m)])
        return np.asarray(windows_m - self.com_start_m[2])

    def _ground_m(self, phase: int) -> float:
        """Mean height of the soles at their current or latest contacts."""
        contacts = [self.sequence.last_contact(name, phase) for name in self.sequence.effectors]
        soles = [c for c in contacts if c is not None and self.effectors[c.effector].kind == "surface"]
        if not soles:
            raise InvalidInput(
                "no-surface-contact", "CoM height bounds are relative to the soles, but none is in contact yet."
            )
        return float(np.mean([c.placement.position_m[2] for c in soles]))

    def end_state(self) -> Float[np.ndarray, "9"]:
        """``(c, c', K / (m |g|))`` at the end, relative to the CoM at the start; at rest unless the end is moving."""
        goal_m = self.com_end_m - self.com_start_m
        if self.terminal != "moving":
            return np.concatenate([goal_m, np.zeros(6)])
        v = self.end.com_v_m_s
        return np.concatenate([goal_m, v, self.end.l_nms / self.weight_n + np.cross(goal_m, v) / GRAVITY_M_S2])

    def capture_region(self) -> CaptureRegion | None:
        """Capture region of a capturable end relative to the CoM at the start; None for other ends."""
        if self.terminal != "capturable":
            return None
        last = self.contact_patches(len(self.sequence.phases) - 1, self.com_start_m)
        return capture_region([patch.points_m for patch in last], self.com_end_m - self.com_start_m)

    def grid(self) -> Grid:
        """``node_rate_hz`` nodes per second of every phase, at least two intervals each, evenly spaced within."""
        counts = [max(NODES_PER_PHASE_MIN, round(p.duration_s * self.node_rate_hz)) for p in self.sequence.phases]
        phase = np.repeat(np.arange(len(counts)), counts)
        step: Series = np.repeat([p.duration_s / n for p, n in zip(self.sequence.phases, counts, strict=True)], counts)
        return Grid(time_s=np.concatenate([[0.0], np.cumsum(step)]), phase=phase, step_s=step)

    def limb_times_s(self) -> Float[np.ndarray, "times"]:
        """Times that bound the averages ``limbs_nm``: the nodes, for splines with one span per Gauss point."""
        return limb_times_s(self.grid().time_s, self.shape)


def standing_com_m(
    phase_contacts: Mapping[str, Contact], height_m: float, effectors: Mapping[str, Effector]
) -> Vector3:
    """CoM at rest in a phase: ``height_m`` above the mean of its surface contacts.

    Raises ``InvalidInput`` (``no-surface-contact``) for a phase without surface contacts.
    """
    soles = [c.placement.position_m for name, c in phase_contacts.items() if effectors[name].kind == "surface"]
    if not soles:
        raise InvalidInput(
            "no-surface-contact", "The robot cannot stand at rest in a phase without a sole on a surface."
        )
    return np.asarray(np.mean(soles, axis=0) + np.array([0.0, 0.0, height_m]))
