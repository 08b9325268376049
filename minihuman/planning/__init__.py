"""Planning: how many participants a study needs.

Studies are drawn from a pool of simulated participants, and tested with the report's own test.
"""
