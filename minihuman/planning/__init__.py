"""Planning: how many participants a study needs. Simulated people from a pool, drawn into studies, tested by the
report's own test.
"""
