"""What the corpus of true splices is worth: beside real signing, against simple rules, and frame by frame."""
