"""Experiment: protocol files, session plans, the session machine and its activities.

The machine performs no I/O: its callers pass inputs and times in.
"""
