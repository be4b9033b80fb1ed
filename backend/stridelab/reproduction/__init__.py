"""Figures of the thesis, computed anew: one module per figure, its numbers beside ours."""
