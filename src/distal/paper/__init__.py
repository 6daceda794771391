"""The 2008 paper: its test series, its statements, and the rig that its authors may have had."""
