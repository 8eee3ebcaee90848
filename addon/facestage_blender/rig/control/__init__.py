"""The control rig: an armature whose handles add to the face's sliders, through drivers that
Blender evaluates without Python.
"""
