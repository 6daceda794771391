"""What tests and benchmarks both need: plants and cases."""
