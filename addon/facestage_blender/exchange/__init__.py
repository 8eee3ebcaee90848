"""Scene and contract: one reader makes a Job of the scene, one writer applies a Result to it."""
