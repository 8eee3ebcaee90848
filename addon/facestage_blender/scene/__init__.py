"""What stands around the face: the frames, the light stage, the camera with its photo."""
