"""The embedded head: a neutral adult modelled from published anthropometry, entirely by code.

May import numpy, scipy and facestage.contract; units inside this folder are millimetres until the
very end.
"""
