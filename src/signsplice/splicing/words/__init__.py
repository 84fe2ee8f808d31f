"""A word of a sentence: its clip aligned to the first one, and brought to the tempo asked for."""
