"""One module for each kind of published model, and one for a user's own rig: a ``FaceModel`` of it.

May import the other rooms of models, but not the registry: who needs the default head is given it.
"""
