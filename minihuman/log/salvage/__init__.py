"""Salvages logs: reads MCAP bytes from front to back, intact or damaged, and reports what is missing."""
