"""Benchmarks: tables and pictures; the tests of their own tools are in `benchmarks.tests`."""
