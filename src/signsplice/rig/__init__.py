"""Which joint is which part of a person, body proportions, and motion carried from rig to rig by rotations."""
