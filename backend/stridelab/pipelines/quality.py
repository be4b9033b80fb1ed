"""The quality of a result: the checks of ``estimation.quality`` in the words of the contract."""

import math
from collections.abc import Sequence

from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.quality import Check, Recorded, assess_quality, worst
from stridelab.estimation.quality import Quality as Assessed
from stridelab.pipelines.com_inputs import Prepared
from stridelab.schemas import quality as contract

LARGEST = 1e12
"""A value beyond it is shown as this: what is infinite is no number of the contract."""


def quality_of(prepared: Prepared, estimate: ComEstimate) -> Assessed:
    """The checks of one estimate from what it was made of."""
    recorded = Recorded(
        recording=prepared.trial.recording,
        landmarks=prepared.trial.match.landmarks,
        geometric=prepared.geometric,
        wrench=prepared.wrench,
        mass_kg=prepared.mass.mass_kg,
        with_force=bool(prepared.windows) and estimate.method != GeometryOnly.name,
        standing_mass_kg=prepared.standing_mass_kg,
        stated_mass_kg=prepared.mass.stated_kg,
    )
    return assess_quality(recorded, estimate)


def as_contract(quality: Assessed) -> contract.Quality:
    """The same for the summary of a result."""
    return contract.Quality(
        verdict=quality.verdict,
        checks=[_check(check) for check in quality.checks],
        not_checked=dict(quality.not_checked),
    )


def of_all(qualities: Sequence[contract.Quality]) -> contract.Quality:
    """The worst value of every check; what is checked nowhere has the reason of the first."""
    checks: dict[str, contract.QualityCheck] = {}
    for check in (check for one in qualities for check in one.checks):
        known = checks.get(check.name)
        if known is None or check.value > known.value:
            checks[check.name] = check
    missing: dict[str, str] = {}
    for one in qualities:
        missing |= {name: why for name, why in one.not_checked.items() if name not in checks and name not in missing}
    return contract.Quality(
        verdict=worst(one.verdict for one in qualities), checks=list(checks.values()), not_checked=missing
    )


def _check(check: Check) -> contract.QualityCheck:
    return contract.QualityCheck(
        name=check.name,
        value=check.value if math.isfinite(check.value) else LARGEST,
        unit=check.unit,
        limit=check.limit,
        contradicted_above=check.contradicted_above,
        passed=check.passed,
        message=check.message,
    )
