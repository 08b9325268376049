"""Policies: their observations, networks and files, and how they act."""
