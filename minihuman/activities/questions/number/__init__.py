"""Questions of kind `number`: type a number."""
