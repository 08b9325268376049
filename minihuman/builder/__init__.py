"""The builder: a study built, tried and run on the desk's page, while its protocol file stays the truth."""
