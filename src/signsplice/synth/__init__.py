"""Corpora of the synthetic signer: random signs, sentences and pairs, with the ground truth of every splice."""
