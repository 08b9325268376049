"""Questions of kinds `text` and `long_text`: type a text."""
