"""What moves when: phases, the view of one photo, start values, the steps of one or several.

May import stereo, energy, solve and what those may import.
"""
