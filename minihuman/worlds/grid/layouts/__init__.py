"""Layouts: where things stand at an episode's start. One function a family, compiled, drawing as Minigrid draws."""
