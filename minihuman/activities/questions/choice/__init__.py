"""Questions of kinds `choice` and `choices`: select one or several options."""
