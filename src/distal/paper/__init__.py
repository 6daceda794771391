"""The reproduction of the 2008 paper: its test series, its statements, and the search for the rig
that its authors may have had.
"""
