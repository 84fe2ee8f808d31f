"""Trains the shipped networks: features, network, checkpoint, bundle."""
