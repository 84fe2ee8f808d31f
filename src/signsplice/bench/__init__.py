"""`signsplice bench`: speed of every part beside its baselines."""
