"""The session log: events to MCAP files and back."""
