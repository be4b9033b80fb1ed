"""Every test checks the criteria of its claims on both sides, and the numbers on the way to them."""

from support.reproduction_fixtures import criteria_of_claims, shared_results, steps_of_test

__all__ = ["criteria_of_claims", "shared_results", "steps_of_test"]
