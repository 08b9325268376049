"""Questions of kinds `choice` and `choices`: one or several of a few options."""
