"""Questions of kinds `text` and `long_text`: words that are typed."""
