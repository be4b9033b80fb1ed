"""Solves a batch of small convex programs: the largest slack ``t`` of half-spaces and balls around a point ``c``.

    t* = max_{c, t} t   such that   a_j c + v_j t <= b_j   and   |c - p_i| <= r_i - w t

The distance to a limit with ``v_j = 1`` (``w = 1``) is maximised; a limit with 0 only has to hold. Each problem is
convex with four unknowns. The solver follows the central path of its logarithmic barrier with Newton steps damped by
``1 / (1 + decrement)``, which stay feasible without a line search (Boyd & Vandenberghe, Convex Optimization, 11.3 and
9.6).

``reach_slacks`` applies it to the reach limits of several contacts. With contact frames ``(R_i, p_i)``, boxes ``[l_i,
u_i]`` and spheres of radius ``r_i`` the slack of a set of contacts is

    t* = max_{c, t} t   such that   l_i + t <= R_i^T (c - p_i) <= u_i - t   and   |c - p_i| <= r_i - t   for all i

It is positive if one CoM position satisfies all limits; otherwise ``-t*`` is the amount by which all limits have to be
widened.

Checks that all contacts of a phase, and of two phases at their transition, are within reach at the same time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.contacts.effector_geometry import EffectorReach
from stridelab.contacts.validation.parse import contact_field
from stridelab.contacts.validation.phase_consistency import same_place
from stridelab.contacts.validation.surface_contact import Stance, SurfaceContact, displacement_text
from stridelab.conventions import Points, Vector3
from stridelab.dynamics.spatial import Placement
from stridelab.errors import Fault

ACCURACY_M: Final = 1e-4
"""Bound on the error of ``t*`` for contacts that are a few metres apart."""
WEIGHT_RATIO: Final = 0.3
"""Ratio of successive barrier weights."""
CENTRING_STEPS: Final = 5
"""Newton steps per barrier weight."""

_DIAGONAL: Final = np.arange(4)

Unknowns = Float[np.ndarray, "s 4"]
"""``(c, t)`` of every program."""


@dataclass(frozen=True, eq=False)
class SlackPrograms:
    """``s`` programs with ``m`` half-spaces and ``n`` balls each; smaller ones repeat some of their own.

    ``rows`` are the ``a_j``, ``widths`` the ``v_j``, ``limits`` the ``b_j``; ``ball_width`` is ``w``.
    """

    rows: Float[np.ndarray, "s m 3"]
    widths: Float[np.ndarray, "s m"]
    limits: Float[np.ndarray, "s m"]
    centers: Float[np.ndarray, "s n 3"]
    radii: Float[np.ndarray, "s n"]
    ball_width: float

    def maximise_slack(self, x: Unknowns) -> tuple[Unknowns, float]:
        """The optima, starting from strictly feasible ``x``, and the last barrier weight."""
        complexity = self.rows.shape[1] + 2 * self.centers.shape[1]
        weight = 1.0
        while weight * complexity > ACCURACY_M:
            weight *= WEIGHT_RATIO
            for _ in range(CENTRING_STEPS):
                x = self._newton_step(x, weight)
        return x, weight

    def slack_gradients(self, x: Unknowns) -> tuple[Float[np.ndarray, "s m 4"], Float[np.ndarray, "s n 4"]]:
        """Gradients of the logarithms of all slacks; multipliers are ``weight / slack`` on the central path."""
        gradients, _ = self._gradients_at(x)
        m = self.limits.shape[1]
        return gradients[:, :m], gradients[:, m:]

    def _gradients_at(self, x: Unknowns) -> tuple[Float[np.ndarray, "s k 4"], Float[np.ndarray, "s n"]]:
        """Gradients of the logarithms of all slacks, half-spaces first, and twice the inverse slacks of the balls."""
        w, m, (rows, gradients) = self.ball_width, self.limits.shape[1], self._arrays
        column = x[:, :, np.newaxis]
        np.divide(rows, (rows @ column - self.limits[..., np.newaxis]), out=gradients[:, :m])
        ball = gradients[:, m:]
        np.subtract(self.centers, x[:, np.newaxis, :3], out=ball[..., :3])
        short = w * x[:, 3:] - self.radii
        inverse = 2.0 / (short * short - np.einsum("snk,snk->sn", ball[..., :3], ball[..., :3]))
        np.multiply(w, short, out=ball[..., 3])
        ball *= inverse[..., np.newaxis]
        return gradients, inverse

    @cached_property
    def _arrays(self) -> tuple[Float[np.ndarray, "s m 4"], Float[np.ndarray, "s k 4"]]:
        """``(a_j, v_j)`` of the half-spaces, and space for all gradients."""
        (s, m), n = self.limits.shape, self.radii.shape[1]
        return np.concatenate([self.rows, self.widths[..., np.newaxis]], axis=2), np.empty((s, m + n, 4))

    def _newton_step(self, x: Unknowns, weight: float) -> Unknowns:
        """One damped Newton step on ``-t / weight - sum log(slack)``."""
        gradients, inverse = self._gradients_at(x)
        grad = gradients.sum(axis=1)
        grad[:, 3] += 1.0 / weight
        H = gradients.transpose(0, 2, 1) @ gradients
        H[:, _DIAGONAL, _DIAGONAL] += inverse.sum(axis=1, keepdims=True) * [1.0, 1.0, 1.0, -(self.ball_width**2)]
        step = np.linalg.solve(H, grad[..., np.newaxis])[..., 0]
        decrement = np.sqrt(np.maximum((grad * step).sum(axis=1), 0.0))
        return np.asarray(x + step / (1.0 + decrement)[:, np.newaxis])


ReachSet = Sequence[tuple[Placement, EffectorReach]]
"""Contacts that must be within reach of one CoM position."""


@dataclass(frozen=True, eq=False)
class Slack:
    """Slack of the reach limits of one set of contacts.

    ``slack_m`` is ``t*``, ``com_m`` the position that attains it. ``gradient`` ``(n, 3)`` is the gradient of ``t*``
    with respect to the position of each contact; the rows sum to zero.
    """

    slack_m: float
    com_m: Vector3
    gradient: Points


def reach_slacks(sets: Sequence[ReachSet]) -> list[Slack]:
    """The slack of every set; no set may be empty."""
    if not sets:
        return []
    problem = ReachLimits.from_sets(sets)
    x, weight = problem.limits.maximise_slack(problem.feasible_start())
    flat, ball = problem.limits.slack_gradients(x)
    pulls = -weight * (flat.reshape(*ball.shape[:2], 6, 4).sum(axis=2) + ball)[..., :3]
    com_m = problem.world_m(x)
    return [Slack(float(problem.scale[i] * x[i, 3]), com_m[i], pulls[i, : len(group)]) for i, group in enumerate(sets)]


@dataclass(frozen=True, eq=False)
class ReachLimits:
    """All sets in one array, lengths relative to ``origin_m`` in units of ``scale``; small sets repeat a contact."""

    limits: SlackPrograms
    origin_m: Float[np.ndarray, "s 3"]
    scale: Float[np.ndarray, "s"]

    @staticmethod
    def from_sets(sets: Sequence[ReachSet], width: float = 1.0) -> "ReachLimits":
        """Create from sets; ``width`` 1 maximises the distance to every limit, 0 only requires that they hold."""
        n = max(len(group) for group in sets)
        padded = [[*group, *[group[0]] * (n - len(group))] for group in sets]
        p = np.array([[at.position_m for at, _ in group] for group in padded])
        R = np.array([[at.rotation for at, _ in group] for group in padded])
        low, high = (np.array([[getattr(r, key) for _, r in group] for group in padded]) for key in _BOUNDS)
        origin = p.mean(axis=1)
        p = p - origin[:, np.newaxis]
        scale = np.maximum(1.0, np.abs(p).max(axis=(1, 2)))
        axes = np.swapaxes(R, 2, 3)
        offset = np.einsum("sikj,sij->sik", axes, p)
        rows = np.concatenate([axes, -axes], axis=2).reshape(len(sets), -1, 3)
        bounds = np.concatenate([offset + high, -offset - low], axis=2).reshape(len(sets), -1) / scale[:, np.newaxis]
        radii = np.array([[reach.com_distance_max_m for _, reach in group] for group in padded]) / scale[:, np.newaxis]
        centers = p / scale[:, np.newaxis, np.newaxis]
        return ReachLimits(
            SlackPrograms(rows, np.full(bounds.shape, width), bounds, centers, radii, width), origin, scale
        )

    def feasible_start(self) -> Unknowns:
        """The mean of the contacts, with ``t`` low enough that every limit holds strictly."""
        balls = self.limits.radii - np.linalg.norm(self.limits.centers, axis=2)
        slack = np.minimum(self.limits.limits.min(axis=1), balls.min(axis=1))
        return np.column_stack([np.zeros((len(slack), 3)), slack - 1.0])

    def world_m(self, x: Unknowns) -> Points:
        """The points ``c`` in world coordinates."""
        return np.asarray(self.scale[:, np.newaxis] * x[:, :3] + self.origin_m)


_BOUNDS: Final = ("com_low_m", "com_high_m")


REACH_TOLERANCE_M: Final = 0.001
"""Tolerance of the reach limits."""
SHIFTS_MAX: Final = 12
"""Maximum iterations of the search for the nearest position within reach."""
FAR_M: Final = 3.0
"""Distance beyond which the fault asks whether lengths are in metres."""
PULL_MIN: Final = 0.02
"""Minimum pull of a contact that counts as part of a conflict."""


@dataclass(frozen=True, eq=False)
class ReachCheck:
    """Slack of the reach limits per phase, None without limits, and the faults."""

    slacks: tuple[Slack | None, ...]
    faults: tuple[Fault, ...]


def check_reach(stances: tuple[Stance, ...]) -> ReachCheck:
    """Check all phases and all transitions; equal sets of contacts are solved once."""
    moments = [(k, contacts_with_limits(stance)) for k, stance in enumerate(stances)]
    for k in range(1, len(stances)):
        both = contacts_with_limits(_merge_stances(stances[k - 1], stances[k]))
        if len(both) > max(len(moments[k - 1][1]), len(moments[k][1])):
            moments.append((k, both))
    unique = {_identity_key(touches): touches for _, touches in moments if touches}
    slack_by_set = dict(zip(unique, reach_slacks([reach_set(touches) for touches in unique.values()]), strict=True))
    faults: list[Fault] = []
    reported: set[frozenset[int]] = set()
    for k, touches in sorted(moments, key=lambda moment: moment[0]):
        slack = slack_by_set.get(_identity_key(touches))
        if slack is None or slack.slack_m >= -REACH_TOLERANCE_M:
            continue
        conflict = [i for i, pull in enumerate(slack.gradient) if np.linalg.norm(pull) > PULL_MIN]
        key = frozenset(id(touches[i]) for i in conflict)
        if key not in reported:
            reported.add(key)
            faults.append(_reach_fault(k, touches, conflict, slack, stances[k - 1] if k else {}))
    return ReachCheck(
        tuple(slack_by_set.get(_identity_key(touches)) for _, touches in moments[: len(stances)]), tuple(faults)
    )


def contacts_with_limits(stance: Stance) -> list[SurfaceContact]:
    """Contacts with reach limits, sorted by effector."""
    return [touch for _, touch in sorted(stance.items()) if touch.shape.reach is not None]


def _merge_stances(before: Stance, after: Stance) -> Stance:
    """Contacts of both phases; an effector in both counts with its contact in ``after``."""
    return {**before, **after}


def _identity_key(touches: Sequence[SurfaceContact]) -> tuple[int, ...]:
    return tuple(id(touch) for touch in touches)


def reach_set(touches: Sequence[SurfaceContact], shifts: dict[int, Vector3] | None = None) -> ReachSet:
    """The reach limits of contacts, some of them shifted (by index)."""
    moved = shifts or {}
    return [
        (Placement(t.placement.position_m + moved.get(i, 0.0), t.placement.rotation), t.shape.reach)
        for i, t in enumerate(touches)
        if t.shape.reach is not None
    ]


def _reach_fault(
    k: int, touches: list[SurfaceContact], conflict: list[int], slack: Slack, previous_stance: Stance
) -> Fault:
    """The fault of the newest contact in a conflict, with the displacement that satisfies all limits."""
    blamed = max(conflict or range(len(touches)), key=lambda i: (_is_new(touches[i], previous_stance), i))
    others = [touches[i].effector for i in conflict if i != blamed]
    missing = _displacement_into_reach_m(touches, blamed, slack)
    distance = float(np.linalg.norm(missing))
    units = " (are all lengths in metres?)" if distance > FAR_M else ""
    anchor = " and ".join(others) or "the robot's reach"
    return Fault(
        contact_field(k, touches[blamed].effector),
        f"{distance:.2f} m too far from {anchor} for this robot: {displacement_text(missing)}{units}",
    )


def _is_new(touch: SurfaceContact, before: Stance) -> bool:
    previous = before.get(touch.effector)
    return previous is None or not same_place(previous, touch)


def _displacement_into_reach_m(touches: list[SurfaceContact], blamed: int, slack: Slack) -> Vector3:
    """Displacement of one contact along the gradient of the slack that brings the slack to zero."""
    total = np.zeros(3)
    for _ in range(SHIFTS_MAX):
        pull = slack.gradient[blamed]
        strength = float(np.linalg.norm(pull))
        if slack.slack_m >= -REACH_TOLERANCE_M or strength < PULL_MIN:
            break
        total = total - slack.slack_m / strength**2 * pull
        (slack,) = reach_slacks([reach_set(touches, {blamed: total})])
    return total
