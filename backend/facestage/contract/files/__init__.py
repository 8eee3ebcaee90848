"""Files and folders, read within limits and written whole: bytes, texts and arrays.

May import numpy, the standard library, and the contract's errors and wording.
"""
