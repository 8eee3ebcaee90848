"""What the face is made of: skin, eyes and lashes, as Cycles and as other programs see them."""
