"""The backend as a child process: where it is, what to ask it, its events and its end. No bpy."""
