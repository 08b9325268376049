"""Worlds: what exists and what an action does. Knows no keys, windows or files."""
