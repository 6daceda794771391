"""The 2008 paper's test series, figures and statements.

`python -m benchmarks.paper_2008`, which `make demo` calls, writes figures, results and a page.
"""
