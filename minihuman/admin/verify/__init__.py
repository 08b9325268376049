"""Verify logs: replay their episodes, and check everything else in them against the protocol and the hash chain."""
