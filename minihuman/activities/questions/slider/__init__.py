"""Questions of kind `slider`: a number on a line."""
