"""A long film in pieces that overlap, followed apart by processes that share one person, and put
together again.

Imports the rooms below it, the sequence's among them.
"""
