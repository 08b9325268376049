"""Keyboard check: every key of the pool must arrive once before data are recorded."""
