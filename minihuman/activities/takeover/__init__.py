"""Takeover: an agent plays, and the person can take control by a key."""
