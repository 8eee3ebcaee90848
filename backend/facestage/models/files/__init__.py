"""Reads the files of published models within limits, and executes nothing that they hold.

May import the contract, numpy, scipy and h5py.
"""
