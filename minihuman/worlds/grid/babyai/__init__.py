"""BabyAI: instructions as a small language, and the levels that draw them.

Instructions are encoded as numbers in a world's state and judged there. A level is a short function that is traced once
into a program.
"""
