"""Trains the networks that ship: features, network, checkpoint, bundle."""
