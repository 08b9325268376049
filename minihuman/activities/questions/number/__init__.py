"""Questions of kind `number`: a number that is typed."""
