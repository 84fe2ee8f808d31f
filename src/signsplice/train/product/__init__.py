"""The networks that ship: training data, augmentation, training, tuning to a lexicon, export to a bundle."""
