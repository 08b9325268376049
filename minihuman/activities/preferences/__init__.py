"""Preferences: which of two clips of episodes is better."""
