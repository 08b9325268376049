"""Experiment: protocol files, session plans, the session machine and its activities. No I/O."""
