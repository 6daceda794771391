"""The lab: a page on which a rig moves in the browser, with its filter."""

from distal.lab.html_page import lab_page
from distal.lab.webassembly import LabModule, check_ziglang, lab_module

__all__ = ["LabModule", "check_ziglang", "lab_module", "lab_page"]
