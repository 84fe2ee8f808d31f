"""Gloss -> clip: for now the words that ship with the package."""
