"""The fuzzer: damaged inputs for every reader, each in a process that may die.

See docs/testing.md.
"""
