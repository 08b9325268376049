"""Salvage: read MCAP bytes front to back, whole or damaged, and say what is missing."""
