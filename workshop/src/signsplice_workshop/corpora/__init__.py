"""Synthetic corpora with the exact truth of every splice."""
