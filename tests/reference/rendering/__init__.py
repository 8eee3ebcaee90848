"""What the renderer computes, slowly and obviously right."""
