"""How two words are joined: where the first is left, the second entered, and how long the new frames take."""
