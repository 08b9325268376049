"""Simulation: participants that use the interface in place of a person."""
