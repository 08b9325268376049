"""Pages: a text read page by page, such as a consent text."""
