"""Geometry and acceleration fused online: ``x = (1 - s^2 H2) g + H2 a`` with its start, hidden markers, missing force.

- start: the least-squares line through the samples so far (k_1 = 4 / t, k_2 = 6 / t^2) until these gains have fallen
  to the filter's own; what has no acceleration, or a measured one, passes unchanged from the first sample on.
- no force measured: the acceleration is unknown, so the line goes through the last 80 ms only; with the force the
  memory grows again.
- no geometry: on by the force alone, without force straight on; after more than a second of that, a new start.
"""

import math
from collections.abc import Sequence
from typing import Final

from stridelab.errors import NotEstimable
from stridelab.estimation.recursions import Observer

MEMORY_WITHOUT_FORCE_S: Final = 0.08
"""A walking body leaves a straight line by 2 mm in this time; that is the lag behind it."""
LONGEST_BLIND_S: Final = 1.0
"""Without geometry for longer than this, nothing of the past is worth keeping."""
_ZERO: Final = (0.0, 0.0, 0.0)


class OnlineTrack:
    """Position and velocity of the three axes, with the gains ``k1`` and ``k2`` that were used last.

    ``blind_s`` is the time since the last geometry; ``knows_velocity`` is False until a second one has come, unless the
    velocity of the start was stated.
    """

    def __init__(self, high_hz: float, velocity_m_s: Sequence[float] | None) -> None:
        w = 2 * math.pi * high_hz
        self._k1, self._k2 = 2 * w, w * w
        self._stated = velocity_m_s
        self._memory_s = 0.0 if velocity_m_s is None else math.inf
        self._begun = self.knows_velocity = False
        self.axes = (Observer(), Observer(), Observer())
        self.k1, self.k2 = 4 / MEMORY_WITHOUT_FORCE_S, 6 / MEMORY_WITHOUT_FORCE_S**2
        self.blind_s = 0.0

    @property
    def is_lost(self) -> bool:
        """Whether the geometry has been missing for so long that its return is a new start."""
        return self.blind_s > LONGEST_BLIND_S

    def step(self, h: float, a: Sequence[float] | None, g: Sequence[float] | None) -> Sequence[float]:
        """Advance by 2h; returns the geometry, or x in its place.

        Raises ``NotEstimable`` (``geometry-missing``) without any geometry to begin with.
        """
        x, y, z = self.axes
        ax, ay, az = a or _ZERO
        t = self._memory_s + 2 * h
        if a is None:
            t = min(t, MEMORY_WITHOUT_FORCE_S)
        self._memory_s = t
        if g is None:
            if not self._begun:
                raise NotEstimable("geometry-missing", "The first sample needs the CoM of the segment model.")
            self.blind_s += 2 * h
            x.coast(h, ax)
            y.coast(h, ay)
            z.coast(h, az)
            return x.x, y.x, z.x
        if not self.knows_velocity:
            self._learn_velocity(self.blind_s + 2 * h, h, (ax, ay, az), g)
            self.blind_s = 0.0
            return g
        self.blind_s = 0.0
        self.k1, self.k2 = k1, k2 = max(self._k1, 4 / t), max(self._k2, 6 / (t * t))
        gx, gy, gz = g
        x.step(h, ax, gx, k1, k2)
        y.step(h, ay, gy, k1, k2)
        z.step(h, az, gz, k1, k2)
        return g

    def _learn_velocity(self, since_s: float, h: float, a: Sequence[float], g: Sequence[float]) -> None:
        """First sample: the stated velocity, or none. Second sample: the one that has led here."""
        for axis, (observer, a_i, g_i) in enumerate(zip(self.axes, a, g, strict=True)):
            if self._begun:
                observer.coast(h, a_i)
                observer.begin(g_i, observer.v + (g_i - observer.x) / since_s, a_i)
            else:
                observer.begin(g_i, 0.0 if self._stated is None else self._stated[axis], a_i)
        self.knows_velocity = self._begun or self._stated is not None
        self._begun = True
