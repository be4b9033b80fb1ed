"""Problems of the centroidal stage over the sequences made by hand."""

from collections.abc import Mapping
from typing import Any

from stridelab.centroidal.problem import CentroidalProblem, standing_com_m
from stridelab.contacts.sequence import ContactSequence
from stridelab.reachability.proxy import Proxy
from support.sequences import COM_HEIGHT_M, EFFECTORS, MASS_KG, PROXIES


def rest_to_rest(
    walk: ContactSequence, proxies: Mapping[str, Proxy] = PROXIES, height_m: float = COM_HEIGHT_M, **settings: Any
) -> CentroidalProblem:
    """From standing over the first phase to standing over the last."""
    start, end = (standing_com_m(walk.phases[i].contacts, height_m, EFFECTORS) for i in (0, -1))
    return CentroidalProblem(walk, MASS_KG, EFFECTORS, proxies, start, end, **settings)
