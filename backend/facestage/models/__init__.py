"""Face models: from a job's specification to a ``FaceModel``; ``registry`` is the way in.

The registry imports the loaders, the loaders correspondence and files, and all of them what is
known of any face and any mesh. May import the contract, the room system, numpy, scipy and h5py.
"""
