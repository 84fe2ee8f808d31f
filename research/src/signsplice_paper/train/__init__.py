"""The paper's systems: networks, losses, data, and the training from a corpus of pairs to a bundle."""
