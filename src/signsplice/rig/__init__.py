"""Roles of joints, body proportions, and rotations transferred from rig to rig."""
