"""A study without a server: a static folder that runs a protocol, and the import of what its pages recorded."""
