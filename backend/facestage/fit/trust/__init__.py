"""What an answer is worth: deviations, null directions, guards, lens, same person, verdict.

May import stages and what that may import.
"""
