"""Administer a study's folder of logs: enrolment, the next session, progress, proofs, payments and withdrawal.

Files and databases only: no window, no session loop and no network server.
"""
