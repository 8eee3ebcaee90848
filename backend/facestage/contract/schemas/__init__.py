"""What the values in a file may be, and the one check of a file against its schema.

May import numpy, marshmallow, the standard library, and the contract's files, errors and wording.
"""
