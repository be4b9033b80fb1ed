"""Bridges from the software of motion-capture systems to a stream of markers."""

from stridelab.cli.bridges.live_markers import LiveMarkers, open_source

__all__ = ["LiveMarkers", "open_source"]
