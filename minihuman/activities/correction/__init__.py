"""Correction: review an episode and demonstrate what should have been done."""
