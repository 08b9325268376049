"""Trials: short episodes that follow each other by the clock."""
