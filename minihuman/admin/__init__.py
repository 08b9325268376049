"""Administer a study's folder of logs: enrolment, the next session, progress, proofs, payments and withdrawal.

The package uses files and databases only; it has no window, no session loop and no network server.
"""
