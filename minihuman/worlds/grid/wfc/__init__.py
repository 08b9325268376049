"""Worlds by Wave Function Collapse: a small picture says what may lie beside what, and chance decides the rest."""
