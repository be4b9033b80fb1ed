"""Checks the sensors of a recording for contradictions: checks, limits and a verdict (docs/theory/quality.md)."""

from stridelab.estimation.quality.assessment import assess_quality
from stridelab.estimation.quality.checks import Check, Quality, worst_verdict
from stridelab.estimation.quality.measures import Recorded

__all__ = ["Check", "Quality", "Recorded", "assess_quality", "worst_verdict"]
