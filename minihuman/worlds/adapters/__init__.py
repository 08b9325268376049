"""Adapters: any Gymnasium environment behind one face."""
