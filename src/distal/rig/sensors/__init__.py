"""Sensors: what is measured, with which errors, and where a log holds it; a kind of sensor is a
file.
"""
