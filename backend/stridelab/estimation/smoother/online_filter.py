"""Online filter of the smoother's model: one sample at a time, at constant cost.

The recursion is the forward pass of ``kalman_rts``. Properties of the whole recording are replaced: the reference of
the moments is the predicted position, and without a given walking direction both horizontal axes use a broad resonator
between stride and step frequency. The unknown constants are constant over the whole stream.
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from stridelab.conventions import GRAVITY_M_S2, Rotation, Vector3
from stridelab.errors import InvalidInput, NotEstimable
from stridelab.estimation.online_estimator import OnlineSample, require_together, step_s
from stridelab.estimation.smoother.kalman_rts import COLUMNS
from stridelab.estimation.smoother.noise_levels import SmootherPriors, online_sizes
from stridelab.estimation.smoother.state_space import (
    ACCELERATION,
    HEIGHT,
    MISSING_VARIANCE_M2,
    MOMENT,
    STATES,
    TABLE,
    C,
    Regime,
    Sizes,
    StateSpace,
    V,
    observation_matrix,
    state_space,
)

TICK_S: Final = 1e-4
"""Resolution of the time steps that share their matrices; ``advance`` corrects the motion for the remainder."""
SPACES: Final = 64
"""Maximum number of cached time steps: a regular clock has one or two; the limit bounds the memory under jitter."""


class OnlineSmoother:
    """Online estimator created by the causal form of ``Smoother``; see ``OnlineEstimator``."""

    def __init__(
        self,
        priors: SmootherPriors,
        mass_kg: float,
        table_sd_m: tuple[float, float, float],
        velocity_m_s: Vector3 | None,
        ahead: Vector3 | None,
    ) -> None:
        self._priors, self._mass_kg, self._table_sd_m = priors, mass_kg, table_sd_m
        self._velocity = np.zeros(3) if velocity_m_s is None else velocity_m_s
        self._frame = _walking_axes(ahead)
        self._directed = ahead is not None
        self._time_s: float | None = None
        self._spaces: dict[int, StateSpace] = {}
        self._filter: CausalFilter | None = None
        self._acceleration: Vector3 | None = None
        self._sizes: Sizes | None = None

    def step(
        self, time_s: float, geometry_m: Vector3 | None, force_n: Vector3 | None, moment_nm: Vector3 | None
    ) -> OnlineSample:
        """CoM at ``time_s`` and its standard deviation along the world's axes.

        Raises ``InvalidInput`` (``not-finite``), ``NotEstimable`` (``geometry-missing``) and otherwise as
        ``OnlineEstimator.step``.
        """
        dt = step_s(self._time_s, time_s)
        require_together(force_n, moment_nm)
        for given in (geometry_m, force_n, moment_nm):
            if given is not None and not np.isfinite(given).all():
                raise InvalidInput("not-finite", "A sample contains a number that is not finite.")
        frame = self._frame
        g = None if geometry_m is None else frame @ geometry_m
        f = None if force_n is None else frame @ force_n
        a = None
        if f is not None:
            a = f / self._mass_kg
            a[2] -= GRAVITY_M_S2
        if self._filter is None:
            if g is None:
                raise NotEstimable("geometry-missing", "The first sample needs the CoM of the segment model.")
            self._sizes = online_sizes(
                self._priors, self._mass_kg, self._table_sd_m, frame, float(g[2]), directed=self._directed
            )
            space = state_space(self._sizes, 200.0)
            self._filter = CausalFilter(space, g, frame @ self._velocity)
        else:
            driven = None if a is None or self._acceleration is None else (a + self._acceleration) / 2
            tick = max(1, round(dt / TICK_S))
            self._filter.advance(self._cached_space(tick), driven, dt - tick * TICK_S)
        self._time_s, self._acceleration = time_s, a
        y2 = None
        if f is not None and moment_nm is not None:
            x, y, z = self._filter.predicted_m.tolist()
            (f0, f1, f2), (n0, n1, _), w = f.tolist(), (frame @ moment_nm).tolist(), self._mass_kg * GRAVITY_M_S2
            y2 = np.array([-(n1 - (z * f0 - x * f2)) / w + x, (n0 - (y * f2 - z * f1)) / w + y, 0.0])
        mean, variance = self._filter.update(g, y2)
        turned = mean @ frame
        return OnlineSample(turned[0], turned[1], np.sqrt(variance @ frame**2))

    def _cached_space(self, tick: int) -> StateSpace:
        if tick not in self._spaces and self._sizes is not None:
            if len(self._spaces) >= SPACES:
                del self._spaces[next(iter(self._spaces))]
            self._spaces[tick] = state_space(self._sizes, 1 / (tick * TICK_S))
        return self._spaces[tick]


class CausalFilter:
    """States of all columns (data, then one per constant), their covariance, and the estimated constants."""

    def __init__(self, space: StateSpace, position_m: Vector3, velocity_m_s: Vector3, phi: float = 1.0) -> None:
        self._space = space
        self._x = np.zeros((3, STATES, COLUMNS))
        self._x[:, C, 0], self._x[:, V, 0] = position_m, velocity_m_s
        self._p = space.start_covariance
        self._gram = np.zeros((3, COLUMNS, COLUMNS))
        self._phi = phi
        self._h = observation_matrix(phi, space.turned)
        self._seen_moment = False
        self._constants = np.zeros((3, HEIGHT))

    @property
    def predicted_m(self) -> Vector3:
        """Position before this sample's measurements."""
        return np.asarray(self._x[:, C, 0] + (self._x[:, C, 1 : HEIGHT + 1] * self._constants).sum(axis=1))

    def advance(self, space: StateSpace, acceleration_m_s2: Vector3 | None, longer_s: float = 0.0) -> None:
        """Predict from the previous sample to this one; the acceleration is None unless both have a force.

        The step is ``longer_s`` longer than that of ``space``: at 240 Hz, 33 us would cause 10 mm/s of velocity error.
        """
        self._space = space
        kind = 2 if not self._seen_moment else 1 if acceleration_m_s2 is None else 0
        now: Regime = space.regimes[kind]
        base = now.transition - now.feed @ self._h
        self._x = base @ self._updated + now.feed @ self._measured
        if acceleration_m_s2 is not None:
            self._x[:, :, 0] += acceleration_m_s2[:, None] * space.drive
            self._x[:, :, 1 + ACCELERATION] -= space.drive
            self._x[:, V, 0] += longer_s * acceleration_m_s2
            self._x[:, V, 1 + ACCELERATION] -= longer_s
        self._x[:, C] += longer_s * self._updated[:, V]
        p = base @ self._p_updated @ np.swapaxes(base, 1, 2) + now.process
        self._p = (p + np.swapaxes(p, 1, 2)) / 2

    def update(self, geometry_m: Vector3 | None, moment_m: Vector3 | None) -> tuple[Float[np.ndarray, "2 3"], Vector3]:
        """Update with a sample; returns position and velocity (rows) and the variance of the position."""
        space = self._space
        noise = space.regimes[2 if moment_m is None else 0].noise_m2
        y = self._h @ self._x
        if geometry_m is None:
            noise = noise.copy()
            noise[:, 0] = MISSING_VARIANCE_M2
        else:
            y[:, 0] = 0.0
            y[:, 0, 0] = geometry_m
            y[:, 0, 1 + TABLE] = -1.0
        if moment_m is not None:
            y[:, 1] = 0.0
            y[:, 1, 0] = moment_m
            y[:2, 1, 1 + ACCELERATION] = -space.lever_s2 * self._phi
            y[:2, 1, 1 + MOMENT] = -self._phi
        self._seen_moment = moment_m is not None
        pht = self._p @ np.swapaxes(self._h, 1, 2)
        s = self._h @ pht
        s[:, 0, 0] += noise[:, 0]
        s[:, 1, 1] += noise[:, 1]
        information = np.linalg.inv(s)
        e = y - self._h @ self._x
        weighted = information @ e
        self._gram += np.swapaxes(e, 1, 2) @ weighted
        self._measured = y
        self._updated = self._x + pht @ weighted
        self._p_updated = self._p - pht @ information @ np.swapaxes(pht, 1, 2)
        return self._position_estimate()

    def _position_estimate(self) -> tuple[Float[np.ndarray, "2 3"], Vector3]:
        sought = slice(1, HEIGHT + 1)
        sd = self._space.constant_sd[:, :HEIGHT]
        core = np.linalg.inv(np.eye(HEIGHT) + sd[:, :, None] * self._gram[:, sought, sought] * sd[:, None, :])
        cov = sd[:, :, None] * core * sd[:, None, :]
        self._constants = -(cov @ self._gram[:, sought, :1])[:, :, 0]
        rows = self._updated[:, :2]
        sensitivity = rows[:, :, sought]
        mean = rows[:, :, 0] + (sensitivity @ self._constants[:, :, None])[:, :, 0]
        first = sensitivity[:, :1]
        variance = self._p_updated[:, C, C] + (first @ cov @ np.swapaxes(first, 1, 2))[:, 0, 0]
        return mean.T, np.maximum(variance, 0.0)


def _walking_axes(ahead: Vector3 | None) -> Rotation:
    if ahead is None:
        return np.eye(3)
    x = ahead * [1.0, 1.0, 0.0]
    x = x / np.linalg.norm(x)
    return np.array([x, [-x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
