"""Reproduction of the figures and tables of the thesis: one module per figure or table, or per group of alike ones."""
