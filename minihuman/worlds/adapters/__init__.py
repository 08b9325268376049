"""Adapters that give any Gymnasium environment one interface."""
