"""Face models: every loader gives a ``facestage.contract.face_model.FaceModel``.

May import the contract, numpy and scipy.
"""
