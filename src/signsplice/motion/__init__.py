"""What a motion is: numpy and scipy only; knows no file, no gloss, no network."""
