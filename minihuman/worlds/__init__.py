"""Worlds: what there is and what an action does. Nothing here knows of keys, windows or files."""
