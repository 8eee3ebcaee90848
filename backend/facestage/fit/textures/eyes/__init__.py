"""Colors of eyes and teeth, and the drawing of an eye (docs/textures.md)."""
