"""Experiments behind pages of the book, run by the scripts named ``make_*``; no part of what is installed."""
