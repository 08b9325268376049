"""Keyboard check: the participant must press every key of the pool once before data are recorded."""
