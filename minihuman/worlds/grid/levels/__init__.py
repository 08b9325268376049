"""Levels: worlds of rooms with a drawn instruction. A level is a few lines over verbs, traced once into numbers."""
