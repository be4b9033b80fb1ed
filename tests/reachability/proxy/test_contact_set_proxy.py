"""The product of the effectors' densities: against its factors, quadrature and a closed form."""

import numpy as np
import pytest

from stridelab.dynamics.spatial import Placement
from stridelab.errors import InvalidInput
from stridelab.reachability.gaussian_mixture import Mixture
from stridelab.reachability.proxy.contact_set_proxy import ContactSet, multiply_mixtures, transform_mixture
from stridelab.reachability.proxy.effector_proxy import Proxy
from stridelab.reachability.store import load_proxies

HEADING_RAD = 0.2
CONTACTS = {
    "left_foot": Placement.from_wxyz((0.0, 0.09, 0.0)),
    "right_foot": Placement.from_wxyz((0.30, -0.11, 0.15), (np.cos(0.1), 0.0, 0.0, np.sin(0.1))),
    "right_hand": Placement.from_wxyz((0.35, -0.5, 0.95), (np.cos(0.2), 0.0, np.sin(0.2), 0.0)),
    "left_hand": Placement.from_wxyz((0.35, 0.5, 0.95)),
}


def some(count: int) -> ContactSet:
    names = list(CONTACTS)[:count]
    return ContactSet.from_placements(
        load_proxies("talos", "uniform"), {name: CONTACTS[name] for name in names}, HEADING_RAD
    )


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_the_product_is_that_of_its_factors(count: int) -> None:
    """The mixture, normalised by construction, against the sum of logarithms less ``log Z``. (4.12)."""
    contacts = some(count)
    c = contacts.sample(400, np.random.default_rng(0))
    np.testing.assert_allclose(contacts.product.log_density(c), contacts.log_density(c), atol=1e-3)
    proxies = load_proxies("talos", "uniform")
    direct = sum(proxies[name].log_density(c, CONTACTS[name], HEADING_RAD) for name in list(CONTACTS)[:count])
    np.testing.assert_allclose(contacts.log_density(c), direct - contacts.log_z, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3])
def test_it_integrates_to_one(count: int) -> None:
    """The midpoint rule on a grid that reaches past every draw."""
    contacts = some(count)
    draws = contacts.sample(20_000, np.random.default_rng(1))
    low, high = draws.min(axis=0) - 0.15, draws.max(axis=0) + 0.15
    step = 0.035
    axes = [np.arange(a, b, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    assert np.exp(contacts.log_density(grid)).sum() * step**3 == pytest.approx(1.0, abs=2e-3)


def test_its_draws_have_its_law() -> None:
    """Importance sampling from the first factor gives the same mean and ``Z``."""
    contacts = some(2)
    rng = np.random.default_rng(2)
    x = contacts.factors[0].sample(200_000, rng)
    weights = np.exp(contacts.factors[1].log_density(x))
    assert np.log(weights.mean()) == pytest.approx(contacts.log_z, abs=0.02)
    mean = (weights[:, None] * x).sum(axis=0) / weights.sum()
    np.testing.assert_allclose(contacts.sample(100_000, rng).mean(axis=0), mean, atol=5e-3)


def test_the_product_of_two_normal_densities_is_the_exact_one() -> None:
    """Equal ones at a distance ``d``: half the variance, ``Z = N(d; 0, 2 S)``; the sets are balls."""
    sd, d = 0.2, 0.3
    one = Mixture(np.ones(1), np.zeros((1, 3)), sd**2 * np.eye(3)[None])
    contacts = multiply_mixtures([one, transform_mixture(one, Placement.from_wxyz((d, 0.0, 0.0)))])
    z = np.exp(-(d**2) / (4 * sd**2)) / (4 * np.pi * sd**2) ** 1.5
    assert contacts.log_z == pytest.approx(np.log(z), abs=1e-12)
    np.testing.assert_allclose(contacts.product.covariances_m2[0], sd**2 / 2 * np.eye(3), atol=1e-15)
    np.testing.assert_allclose(contacts.mode_m(), [d / 2, 0.0, 0.0], atol=1e-6)
    radius = 2.7955 * sd / np.sqrt(2)  # chi with three degrees of freedom holds 95 % within 2.7955
    assert contacts.volumes_m3([0.95])[0] == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.05)


def test_more_contacts_leave_less_room_and_the_mode_is_the_top() -> None:
    sets = [some(count) for count in (2, 3, 4)]
    volumes = np.array([contacts.volumes_m3([0.5, 0.95]) for contacts in sets])
    assert (np.diff(volumes, axis=0) < 0.0).all()
    for contacts in sets:
        draws = contacts.sample(5000, np.random.default_rng(3))
        assert contacts.log_density(contacts.mode_m()[None])[0] >= contacts.log_density(draws).max()


def test_omitted_components_have_little_weight() -> None:
    contacts = some(4)
    all_of_them = np.prod([len(factor.weights) for factor in contacts.factors])
    assert len(contacts.product.weights) < 0.5 * all_of_them


def test_contacts_without_densities_are_refused() -> None:
    proxies = {"left_foot": Proxy(Mixture(np.ones(1), np.zeros((1, 3)), np.eye(3)[None]))}
    with pytest.raises(InvalidInput, match="tail"):
        ContactSet.from_placements(proxies, {"tail": Placement.identity()}, 0.0)
    with pytest.raises(InvalidInput, match="one contact"):
        ContactSet.from_placements(proxies, {}, 0.0)
