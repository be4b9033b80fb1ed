"""Problems of the centroidal stage over the sequences made by hand."""

from collections.abc import Mapping
from typing import Any

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.proxy import Proxy
from support.sequences import COM_HEIGHT_M, EFFECTORS, MASS_KG, PROXIES, foot, phase, sequence


def rest_to_rest(
    walk: ContactSequence, proxies: Mapping[str, Proxy] = PROXIES, height_m: float = COM_HEIGHT_M, **settings: Any
) -> CentroidalProblem:
    """From standing over the first phase to standing over the last."""
    start, end = (standing_com_m(walk.phases[i].contacts, height_m, EFFECTORS) for i in (0, -1))
    return CentroidalProblem(walk, MASS_KG, EFFECTORS, proxies, start, end, **settings)


def with_a_contact_between(**settings: Any) -> CentroidalProblem:
    """Two steps: the right foot's first landing is neither the start nor the goal."""
    left, right, ahead, far = foot("left", 0.0), foot("right", 0.0), foot("right", 0.25), foot("left", 0.45)
    walk = sequence(
        phase(0.6, left, right),
        phase(0.8, left),
        phase(0.4, left, ahead),
        phase(0.8, ahead),
        phase(0.4, far, ahead),
        phase(0.8, far),
        phase(0.8, far, foot("right", 0.45)),
    )
    return rest_to_rest(walk, **settings)
