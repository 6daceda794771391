"""Tests of the benchmarks' own tools: rivals, mutants, searches, and that each benchmark starts."""
