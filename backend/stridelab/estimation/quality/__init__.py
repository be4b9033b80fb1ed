"""Checks the sensors of a recording for contradictions: checks, limits and a verdict (docs/theory/quality.md)."""

from stridelab.estimation.quality.assessment import Check, Quality, assess_quality, worst_verdict
from stridelab.estimation.quality.measures import Recorded

__all__ = ["Check", "Quality", "Recorded", "assess_quality", "worst_verdict"]
