"""Preferences: the participant compares two clips of episodes."""
