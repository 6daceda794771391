"""What `distal` is to packages in which people already work."""
