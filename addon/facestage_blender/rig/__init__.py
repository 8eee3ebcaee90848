"""The face in the scene: a mesh with sliders and a skin material, from a model or of the user's."""
