"""Pictures and films of a clip's signer."""

PICTURE_SUFFIXES = (".png", ".gif", ".mp4")
"""File suffixes that ``film.write_pictures`` supports."""
