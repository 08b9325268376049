"""The session machine: inputs in, events out. It has no clock, files or windows."""
