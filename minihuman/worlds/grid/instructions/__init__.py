"""Instructions: what to do as a small language, compiled to numbers in a world's state and judged there."""
