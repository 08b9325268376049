"""Worlds: the environments, their states and the effects of actions. This package knows no keys, windows or files."""
