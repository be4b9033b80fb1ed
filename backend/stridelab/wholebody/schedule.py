"""When soles swing, by the plan."""

import numpy as np

from stridelab.contacts.sequence import ContactSequence
from stridelab.conventions import Series


def swung_shares(sequence: ContactSequence, time_s: Series) -> dict[str, Series]:
    """Per effector and sample how far its swing has come, from 0 at its lift-off; 1 where it touches."""
    found = {name: np.ones(len(time_s)) for name in sequence.effectors}
    for name, share in found.items():
        first: int | None = None
        for k, phase in enumerate(sequence.phases):
            if name in phase.contacts:
                first = None
                continue
            if first is None:
                first = k
                last = k
                while last + 1 < len(sequence.phases) and name not in sequence.phases[last + 1].contacts:
                    last += 1
                start, end = float(sequence.starts_s[first]), float(sequence.ends_s[last])
                inside = (time_s + 1e-9 >= start) & (time_s + 1e-9 < end)
                share[inside] = (time_s[inside] - start) / (end - start)
    return found
