"""Questions of kind `slider`: choose a number on a line."""
