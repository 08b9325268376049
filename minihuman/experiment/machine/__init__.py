"""The session machine: inputs in, events out. No clock, files or windows."""
