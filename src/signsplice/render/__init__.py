"""Pictures and films of a clip's signer."""

PICTURE_SUFFIXES = (".png", ".gif", ".mp4")
"""Suffixes that ``film.write_pictures`` writes."""
