"""Agents: who chooses actions."""
