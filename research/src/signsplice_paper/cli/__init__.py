"""The commands of `signsplice-paper`."""
