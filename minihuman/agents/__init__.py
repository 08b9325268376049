"""Agents: policies that choose actions in a world."""
