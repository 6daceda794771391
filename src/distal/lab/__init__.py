"""The lab: a rig with its filter in the browser, as one file."""

from distal.lab.module import LabModule, check_ziglang, lab_module
from distal.lab.page import lab_page

__all__ = ["LabModule", "check_ziglang", "lab_module", "lab_page"]
