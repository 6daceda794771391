"""The reproduction of the 2008 paper: its test series and its statements.

`python -m benchmarks.paper_2008`, which `make demo` calls, writes figures, results and a page.
"""
