"""Worlds that are not ours, in processes of their own: what fails there fails alone."""
