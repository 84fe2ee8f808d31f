"""Every measurement of the project: hidden frames, seams, collisions, the corpus, and speed."""
