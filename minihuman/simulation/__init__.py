"""Simulation: who uses the interface instead of a person."""
