"""Takeover: an agent plays, and a key of the person takes control."""
