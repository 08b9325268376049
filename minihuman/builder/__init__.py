"""The builder: make, try and run a study on the start page, with the protocol file as the only truth."""
