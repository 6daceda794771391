"""A rig from a MuJoCo model: joints and links are taken as they are, tendons from the lengths that
MuJoCo computes.
"""
