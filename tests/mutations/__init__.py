"""Mutation testing: do the tests notice when one place of the package means something else?

    python -m tests.mutations draw                  choose the drawn mutants and write them to drawn.json
    python -m tests.mutations record FOLDER         run every test file under coverage, outside the repository
    python -m tests.mutations run FOLDER [NUMBER ...]   try mutants and write mutants.tsv

Forty-five mutants: fifteen planted by hand and thirty drawn by a seed. For each only the tests that execute its line
run, the cheapest first, until one fails. Needs coverage.py (`pip install -e ".[dev]"`).
"""
