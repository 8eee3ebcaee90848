"""Many photos, on many processes and machines: a manifest in, a folder of results and a table out.

May import everything of the backend but the renderer and the command line; Dask is imported here
alone, and only while a batch runs.
"""
