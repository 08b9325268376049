"""BabyAI: instructions as a small language, and the levels that draw them.

Instructions are compiled to numbers in a world's state and judged there. A level is a few lines over verbs, traced once
into a program.
"""
