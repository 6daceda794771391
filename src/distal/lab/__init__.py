"""The lab: a rig with its filter in the browser, as one file."""

from distal.lab.html_page import lab_page
from distal.lab.webassembly import LabModule, check_ziglang, lab_module

__all__ = ["LabModule", "check_ziglang", "lab_module", "lab_page"]
