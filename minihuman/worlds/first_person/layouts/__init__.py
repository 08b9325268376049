"""What stands where in each world, and when it ends."""
