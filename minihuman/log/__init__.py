"""The session log: writes events to MCAP files and reads them back."""
