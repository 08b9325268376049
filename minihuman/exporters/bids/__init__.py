"""Export a study as a BIDS dataset: Brain Imaging Data Structure 1.11, https://bids-specification.readthedocs.io."""
