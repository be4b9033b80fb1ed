"""Speed of the wrench cones (section 4.4); run by ``make bench`` (skipped otherwise)."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from stridelab.contacts.wrench_cones.support_region import com_region_m
from stridelab.contacts.wrench_cones.wrench_cone import LinearCone
from stridelab.contacts.wrench_cones.wrench_feasibility import conic_margin, linear_margin
from stridelab.reproduction.studies.cone_validation import thesis_cone
from stridelab.reproduction.studies.random_contact_sets import random_contacts, random_wrench

BODIES = (2, 3, 4)


@pytest.fixture(autouse=True)
def one_thread():
    """As in a job."""
    with threadpool_limits(1):
        yield


@pytest.mark.parametrize("bodies", BODIES)
def test_largest_cone(benchmark, bodies):
    """Facets and the largest Lorentz cone inside, another contact set in every round."""
    rng = np.random.default_rng(bodies)
    benchmark.pedantic(
        lambda contacts: LinearCone.from_contacts(contacts).largest_lorentz(),
        setup=lambda: ((random_contacts(rng, bodies),), {}),
        rounds=40,
    )


def test_thesis_cone(benchmark):
    """The thesis' four steps on three bodies."""
    rng = np.random.default_rng(3)
    benchmark.pedantic(thesis_cone, setup=lambda: ((random_contacts(rng, 3),), {}), rounds=20)


@pytest.mark.parametrize("margin", [conic_margin, linear_margin])
def test_margin(benchmark, margin):
    """Of a wrench on three bodies, with its forces."""
    rng = np.random.default_rng(3)
    contacts = random_contacts(rng, 3)
    benchmark.pedantic(margin, setup=lambda: ((contacts, random_wrench(rng, contacts)), {}), rounds=40)


@pytest.mark.parametrize("bodies", BODIES)
def test_region_at_rest(benchmark, bodies):
    """Where the contacts hold a CoM."""
    contacts = random_contacts(np.random.default_rng(bodies), bodies)
    benchmark.pedantic(lambda: com_region_m(contacts), rounds=40)
