"""Relief finer than the mesh: told from pigment, as height and normals (docs/textures.md)."""
