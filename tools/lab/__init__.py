"""The lab: a page on which a rig moves in the browser, with its filter."""

from tools.lab.html_page import lab_page
from tools.lab.webassembly import check_ziglang

__all__ = ["check_ziglang", "lab_page"]
