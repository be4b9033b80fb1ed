"""Statements in the thesis' words that the thesis does not make: of other people, other gaits, all trials."""

from stridelab.reproduction.claims import Basis, Claim, target


def as_own_aim(claim: Claim) -> Claim:
    """The same statement, number and bounds as an aim of this project, without a place in the thesis."""
    basis: Basis = {"n": claim.n, "evidence": claim.evidence, "solver": claim.solver, "comparator": claim.comparator}
    if claim.cases_inside is not None:
        basis["cases_inside"] = claim.cases_inside
    elif claim.no_interval is not None:
        basis["no_interval"] = claim.no_interval
    else:
        basis["interval"] = claim.interval
    numbers = target(claim.key, claim.ours, claim.unit, at_least=claim.holds_from, at_most=claim.holds_to)
    return numbers.says(claim.says, claim.note, **basis)
