"""The log: session events to MCAP and back."""
