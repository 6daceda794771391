"""Least squares over several logs: features, random effects, the size of a band, a homing window, the kernel."""
