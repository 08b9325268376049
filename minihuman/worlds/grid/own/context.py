"""The context of a world while its compiled rules run: a block of eight addresses and a length, all int64."""

ROW, ROW_LENGTH_WORD, OWN_NUMBERS, INT_SETTINGS, FLOAT_SETTINGS, RNG, FAULT, MISSION, SCRATCH = range(9)
