"""Bridges from the software of motion-capture systems to a stream of markers."""
