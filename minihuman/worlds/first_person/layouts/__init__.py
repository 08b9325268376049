"""Layouts: what stands where in each world, what a step earns, and when the episode ends."""
