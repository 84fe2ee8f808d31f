"""Every measurement of this project's own: transitions, seams, collisions, the corpus of pairs, and speed."""
