"""Runs: phases with deadline, checkpoint, progress and trace; one photo or several.

May import trust and what those may import.
"""
