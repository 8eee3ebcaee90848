"""The machine: Facestage's folders, other Pythons, and the libraries that the renderer needs.

May import the contract and the standard library.
"""
