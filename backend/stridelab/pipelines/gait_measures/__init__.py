"""Measures of gait of recordings."""
