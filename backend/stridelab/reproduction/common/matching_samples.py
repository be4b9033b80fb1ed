"""Samples of one track at the times of another one."""

import numpy as np
from jaxtyping import Float


def matching_samples(time_s: Float[np.ndarray, "n"], of_s: Float[np.ndarray, "m"]) -> slice:
    """The samples from the one nearest to the first of ``of_s`` to the one nearest to its last, both included."""
    first, last = (int(np.argmin(np.abs(time_s - at_s))) for at_s in (of_s[0], of_s[-1]))
    return slice(first, last + 1)
