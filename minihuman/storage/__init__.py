"""Durable storage: the disk and durable writes, locks, journals, leases, remote stores, and erasure.

All changes to files go through the disk of ``storage.system``, which a test can make fail.
"""
