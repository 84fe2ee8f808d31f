"""The solid body around a skeleton: capsules, collision, arm inverse kinematics, and the mesh for pictures."""
