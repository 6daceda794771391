"""Benchmarks: tables and pictures, not tests."""
