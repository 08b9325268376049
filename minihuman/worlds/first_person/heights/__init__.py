"""First-person worlds with heights: floors above each other, stairs, ramps, balconies and holes."""
