"""Quality of a result: converts the checks of ``estimation.quality`` to the response schema."""

import math
from collections.abc import Sequence

from stridelab.estimation.estimator import ComEstimate
from stridelab.estimation.markers_only import GeometryOnly
from stridelab.estimation.quality import Check, Recorded, assess_quality, worst_verdict
from stridelab.estimation.quality import Quality as Assessed
from stridelab.pipelines.com_inputs import ComInputs
from stridelab.schemas import quality as contract

MAX_REPORTED_VALUE = 1e12
"""Replaces infinite values, which JSON cannot represent."""


def assess_estimate(prepared: ComInputs, estimate: ComEstimate) -> Assessed:
    """Check one estimate against its inputs."""
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


def quality_schema(quality: Assessed) -> contract.Quality:
    """Convert a quality assessment to the response schema."""
    return contract.Quality(
        verdict=quality.verdict,
        checks=[_check_schema(check) for check in quality.checks],
        not_checked=dict(quality.not_checked),
    )


def worst_quality(qualities: Sequence[contract.Quality]) -> contract.Quality:
    """The worst value of every check; a check made in no result has the reason given by the first."""
    checks: dict[str, contract.QualityCheck] = {}
    for check in (check for quality in qualities for check in quality.checks):
        previous = checks.get(check.name)
        if previous is None or check.value > previous.value:
            checks[check.name] = check
    missing: dict[str, str] = {}
    for quality in qualities:
        missing = {name: why for name, why in quality.not_checked.items() if name not in checks} | missing
    return contract.Quality(
        verdict=worst_verdict(quality.verdict for quality in qualities),
        checks=list(checks.values()),
        not_checked=missing,
    )


def _check_schema(check: Check) -> contract.QualityCheck:
    return contract.QualityCheck(
        name=check.name,
        value=check.value if math.isfinite(check.value) else MAX_REPORTED_VALUE,
        unit=check.unit,
        limit=check.limit,
        contradicted_above=check.contradicted_above,
        passed=check.passed,
        message=check.message,
    )
