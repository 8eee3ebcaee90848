"""One run from start to end: deadline, checkpoint, progress, trace; one photo or several.

May import trust and what that may import.
"""
