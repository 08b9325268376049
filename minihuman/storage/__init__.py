"""What lasts: the disk and how files are written durably, locks, journals, leases, remote stores, and erasure.

Everything that changes a file does so through the disk of ``storage.system``, which a test can let fail.
"""
