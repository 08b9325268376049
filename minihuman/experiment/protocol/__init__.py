"""Protocols: read a study's TOML file, validate it and report every error with its line."""
