"""Steps of a sideways walk: how the way of two steps is divided between them, and what corrects their way.

The sole of the side towards which the robot walks leads. With the usual distance s of the soles,

    leading = s + min(way, widest - s) ,    trailing = s - min(what is left of the way, s - nearest) .

Steps come short of the way that is commanded: soles are narrow, so that the pressure in them cannot correct what the
pendulum predicts wrong. The way is therefore multiplied by a factor that follows from the steps before.
"""

from collections import deque

import numpy as np

from stridelab.wholebody.recovery.step_choice import Shift


def side_steps_m(way_m: float, usual_m: float, nearest_m: float, widest_m: float) -> tuple[float, float]:
    """Distance of the soles from each other after the leading and after the trailing step of a way (m)."""
    outwards_m = min(way_m, widest_m - usual_m)
    return usual_m + outwards_m, usual_m - min(way_m - outwards_m, usual_m - nearest_m)


class WayCorrection:
    """The ``factor`` of the commanded way, within ``limits``.

    Two steps that miss a share of their way change it by ``gain`` times this share, if the way was at least
    ``shortest_m``.
    """

    def __init__(self, gain: float, limits: tuple[float, float], shortest_m: float) -> None:
        self._gain, self._limits, self._shortest_m = gain, limits, shortest_m
        self._landings: deque[tuple[float, Shift]] = deque(maxlen=4)
        self.factor = 1.0

    def begin_walk(self) -> None:
        """Forget the places of the walk before, not the factor."""
        self._landings.clear()

    def add_landing(self, commanded_m: float, middle_m: Shift, left: Shift) -> None:
        """Compare the last two steps with their command, which the soles follow one step later.

        ``commanded_m`` is the way that was commanded until now, ``middle_m`` the middle between the soles, ``left`` the
        direction to the left of the robot.
        """
        self._landings.append((commanded_m, middle_m))
        if len(self._landings) < 4:
            return
        (begun_m, _), (_, from_m), (ended_m, _), (_, to_m) = self._landings
        way_m, (least, most) = ended_m - begun_m, self._limits
        if abs(way_m) >= self._shortest_m:
            share = float(np.dot(left, to_m - from_m)) / way_m
            self.factor = min(max(self.factor + self._gain * (1.0 - share), least), most)
