"""Search for the rig that the authors of the 2008 paper may have had: `python -m
benchmarks.rig_search FOLDER` (15 minutes).

It draws plants over what is not printed, runs every test on each, and writes a map of the
statements that hold to the folder.
"""

from __future__ import annotations

import sys

from distal.paper.map import SEARCH_FILES, search_in_words, write_search
from distal.paper.rig_search import search_rigs


def main(folder: str) -> None:
    searched = search_rigs(lambda done: print(f"{done} plants", file=sys.stderr))
    write_search(searched, folder)
    for line in search_in_words(searched):
        print(line)
    print(f"wrote {', '.join(f'{folder}/{name}' for name in SEARCH_FILES)}")


if __name__ == "__main__":
    main(*(sys.argv[1:] or ["out/search"]))
