"""What methods, bodies, tempo and the corpus are worth, in numbers."""
