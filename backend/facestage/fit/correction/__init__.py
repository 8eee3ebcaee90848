"""A sequence that an artist has corrected in some frames: what that says of those beside them.

Imports the rooms below it, the sequence's among them.
"""
